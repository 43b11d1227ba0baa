/* The master algorithm: one loop for every scheme; what differs is data (schemes.py says what the fields mean).
 *
 * A step: continue every signal from its past; let each unit step on its inputs' polynomials; where the scheme is sequential, later
 * units see what earlier ones have just computed, interpolated. With several sweeps the step is repeated from the saved states on
 * the interpolants until what feeds back no longer moves; an adaptive scheme repeats it shorter where the continuation was off.
 * A step that is final takes the sinks along: units that no other reads.
 * reference.py is the same in plain FMPy, operation by operation, so that both give the same bits.
 */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "master/master.h"
#include "monolithic/monolithic.h"

/* Signals ------------------------------------------------------------------------------------------------------------------- */

static void extrapolate(Master *m, const Unit *unit, double h) {
  int degree = m->plan.scheme.extrapolation;
  size_t s = (size_t)unit->first_signal, end = s + unit->real_outputs.n;
  for (; s < end; s++) {
    m->p[s] = unit->output_derivatives ? extrapolate_with_slope(&m->past[s], degree, m->known, m->h_prev)
                                       : extrapolate_values(&m->past[s], degree, m->known, m->h_prev, m->h_prev2);
    m->expected[s] = value(&m->p[s], h);
  }
  for (end += n_discrete(unit); s < end; s++) {
    m->p[s] = constant(m->past[s].y);
    m->expected[s] = m->past[s].y;
  }
}

static void interpolate(Master *m, const Unit *unit, double h) {
  size_t s = (size_t)unit->first_signal, end = s + unit->real_outputs.n;
  for (; s < end; s++) m->p[s] = interpolated(m, unit, s, h);
  for (end += n_discrete(unit); s < end; s++) m->p[s] = constant(m->y[s]);
}

static double sample_at(const Master *m, const double *samples, size_t k, double t) {
  const double *time = m->plan.sample_time;
  if (t <= time[0]) return samples[0];
  if (k + 1 >= m->plan.n_samples) return samples[m->plan.n_samples - 1];
  return samples[k] + (samples[k + 1] - samples[k]) * ((t - time[k]) / (time[k + 1] - time[k]));
}

static size_t sample_before(const Master *m, size_t k, double t) {
  while (k + 1 < m->plan.n_samples && m->plan.sample_time[k + 1] <= t) k++;
  return k;
}

/* The sample from which on inputs that hold theirs do: the one at a tick, however times are rounded */
static size_t held_since(const Master *m, size_t k, double t) {
  return sample_before(m, k, t + AT_TICK * m->plan.step);
}

/* The system's inputs: the chord over the step, or what is held at its begin; exact where no sample lies inside */
static void follow_inputs(Master *m, double t, double t_end, double h) {
  if (m->plan.n_inputs == 0) return;
  m->sample = sample_before(m, m->sample, t);
  size_t k_end = sample_before(m, m->sample, t_end), k_held = held_since(m, m->sample, t);
  for (size_t j = 0; j < m->plan.n_inputs; j++) {
    const double *samples = m->plan.samples + j * m->plan.n_samples;
    if (m->plan.held[j]) {
      m->p[m->plan.n_outputs + j] = constant(samples[k_held]);
      continue;
    }
    m->p[m->plan.n_outputs + j] = line(sample_at(m, samples, m->sample, t), sample_at(m, samples, k_end, t_end), h);
  }
}

/* Off by how many tolerances: the worst of what readers expected of signals (then they expect what came out), and of energy that
 * one unit gave and the next did not take in a step of length h: it tells of impacts that are over before the step is. */
static double coupling_error(Master *m, double h) {
  double worst = 0, tolerance = m->plan.scheme.tolerance;
  for (size_t s = 0; s < m->plan.n_outputs; s++) {
    if (!m->plan.judged[s]) continue;
    double error = fabs(m->y[s] - m->expected[s]) / (tolerance * (m->plan.nominal[s] + fabs(m->y[s])));
    if (!(error <= worst)) worst = error; /* NaN counts as worst */
    m->expected[s] = m->y[s];
  }
  for (size_t k = 0; k < m->plan.n_flows; k++) {
    const Flow *flow = &m->plan.flows[k];
    double given = m->y[flow->given] - m->past[flow->given].y, taken = m->y[flow->taken] - m->past[flow->taken].y;
    double error = fabs(given - taken) / (tolerance * (flow->power * h + fabs(given)));
    if (!(error <= worst)) worst = error;
  }
  return worst;
}

/* Steps --------------------------------------------------------------------------------------------------------------------- */

static int sweep(Master *m, double t, double h) {
  m->count.sweeps++;
  for (size_t i = 0; i < m->plan.n_units; i++) {
    if (m->plan.units[i].is_sink) continue;
    int status = step_unit(m, i, t, 0, h);
    if (status) return status;
    if (m->plan.scheme.sequential) interpolate(m, &m->plan.units[i], h);
  }
  return 0;
}

static void accept(Master *m, double h) {
  for (size_t s = 0; s < m->plan.n_outputs; s++) {
    Past *past = &m->past[s];
    past->y_prev2 = past->y_prev;
    past->y_prev = past->y;
    past->dy_prev = past->dy;
    past->y = m->y[s];
    past->dy = m->dy[s];
  }
  for (size_t k = 0; k < m->plan.n_ports; k++) {
    m->total[k] += m->work[k];
    m->total_abs[k] += fabs(m->work[k]);
  }
  m->h_prev2 = m->h_prev;
  m->h_prev = h;
  m->known += m->known < 3;
  m->tick += m->stride;
  m->count.steps++;
}

/* Strides are powers of two, aligned to themselves. The error grows as the step to the power extrapolation + 1; after a step was
 * taken back, growth waits, lest the coupling be tried at its limit of stability over and over. */
static void choose_stride(Master *m, double error) {
  enum { CALM = 8 };
  double room = (double)(2 << m->plan.scheme.extrapolation);
  int64_t doubled = 2 * m->stride;
  bool aligned = doubled <= m->plan.max_stride && m->tick % doubled == 0;
  if (++m->calm > CALM && error * room < 0.5 && aligned) m->stride = doubled;
}

/* No longer than to `tick` or, for long steps, to where an input turns */
static void limit_stride(Master *m, int64_t tick) {
  int64_t most = tick - m->tick;
  if (m->plan.scheme.adaptive) {
    while (m->next_break < m->plan.n_breaks && m->plan.breaks[m->next_break] <= m->tick) m->next_break++;
    if (m->next_break < m->plan.n_breaks && m->plan.breaks[m->next_break] - m->tick < most)
      most = m->plan.breaks[m->next_break] - m->tick;
  }
  while (m->stride > most) m->stride /= 2;
}

static int step_sinks(Master *m, double t, double s, double h, bool recorded) {
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (!unit->is_sink) continue;
    if (step_unit(m, i, t, s, h)) return -1;
    if (!recorded) continue;
    if (get_watched(m, unit)) return -1;
    for (size_t k = (size_t)unit->first_signal; k < (size_t)unit->first_signal + n_watched(unit); k++)
      m->p[k] = constant(m->y[k]);
  }
  return 0;
}

/* The step just computed is final: sinks follow on the signals' interpolants, recorded ticks inside it get their rows */
static int follow(Master *m, double t, double h, double **row) {
  int64_t every = m->plan.ticks_per_record, end = m->tick + m->stride;
  if (!m->plan.scheme.sequential && (m->stride > every || rolls_back(m)))
    for (size_t i = 0; i < m->plan.n_units; i++) interpolate(m, &m->plan.units[i], h);
  for (int64_t tick = m->tick, next; tick < end; tick = next) {
    next = (tick / every + 1) * every < end ? (tick / every + 1) * every : end;
    double s = (double)(tick - m->tick) * m->plan.step, s_next = (double)(next - m->tick) * m->plan.step;
    if (step_sinks(m, t, s, s_next - s, next < end)) return -1;
    if (next == end) return 0;
    for (size_t j = 0; j < m->plan.n_recorded; j++) {
      const Wire *wire = &m->plan.recorded[j];
      (*row)[j] = wire->factor * value(&m->p[wire->signal], s_next) + wire->offset;
    }
    *row += m->plan.n_recorded;
    m->rows++;
  }
  return 0;
}

static int step(Master *m, double **row) {
  const Scheme *scheme = &m->plan.scheme;
  if (rolls_back(m) && save_states(m)) return -1;
  double t = time_of(m, m->tick), h, error = 0;
  for (;;) {
    h = (double)m->stride * m->plan.step;
    for (size_t i = 0; i < m->plan.n_units; i++) extrapolate(m, &m->plan.units[i], h);
    follow_inputs(m, t, time_of(m, m->tick + m->stride), h);
    int status = sweep(m, t, h);
    for (int k = 1; status == 0 && k < scheme->sweeps && coupling_error(m, h) > 1; k++) {
      if (!scheme->sequential)
        for (size_t i = 0; i < m->plan.n_units; i++) interpolate(m, &m->plan.units[i], h);
      if (restore_states(m)) return -1;
      status = sweep(m, t, h);
    }
    if (status < 0) return -1;
    if (!scheme->adaptive) break;
    error = status == DISCARDED ? HUGE_VAL : coupling_error(m, h);
    if (error <= 1 || m->stride == 1) break;
    if (restore_states(m)) return -1;
    m->stride /= 2;
    m->calm = 0;
    m->count.rejected++;
  }
  if (follow(m, t, h, row)) return -1;
  accept(m, h);
  if (scheme->adaptive) choose_stride(m, error);
  return 0;
}

/* Calls from Python --------------------------------------------------------------------------------------------------------- */

int cosim_begin(Master *m, int64_t tick) {
  m->tick = tick;
  m->rows = 0;
  m->stride = 1;
  m->known = 1;
  m->beyond = false;
  m->calm = 0;
  m->next_break = 0;
  m->sample = m->plan.n_samples ? sample_before(m, 0, time_of(m, tick)) : 0;
  m->count = (Counters){0};
  for (size_t i = 0; i < m->plan.n_units; i++)
    if (get_outputs(m, &m->plan.units[i]) || get_first_slopes(m, &m->plan.units[i])) return -1;
  for (size_t s = 0; s < m->plan.n_outputs; s++) m->past[s] = (Past){.y = m->y[s], .dy = m->dy[s]};
  for (size_t k = 0; k < m->plan.n_ports; k++) m->total[k] = m->total_abs[k] = 0;
  return m->monolithic ? monolithic_begin(m->monolithic, m) : 0;
}

int cosim_resume(Master *m) {
  m->stride = 1;
  for (size_t i = 0; i < m->plan.n_units; i++)
    if (get_outputs(m, &m->plan.units[i])) return -1;
  for (size_t s = 0; s < m->plan.n_outputs; s++) {
    Past *past = &m->past[s];
    double jump = m->y[s] - past->y;
    past->y = m->y[s];
    past->y_prev += jump;
    past->y_prev2 += jump;
  }
  return m->monolithic ? monolithic_resume(m->monolithic, m) : 0;
}

static double input_at(const Master *m, size_t j, size_t k, double t) {
  const double *samples = m->plan.samples + j * m->plan.n_samples;
  return m->plan.held[j] ? samples[held_since(m, k, t)] : sample_at(m, samples, k, t);
}

int cosim_record(Master *m, double *row) {
  double t = time_of(m, m->tick);
  size_t k = m->plan.n_inputs ? sample_before(m, m->sample, t) : 0;
  for (size_t i = 0; i < m->plan.n_units; i++)
    if (get_watched(m, &m->plan.units[i])) return -1;
  for (size_t j = 0; j < m->plan.n_recorded; j++) {
    const Wire *wire = &m->plan.recorded[j];
    size_t s = (size_t)wire->signal;
    double y = s < m->plan.n_outputs ? m->y[s] : input_at(m, s - m->plan.n_outputs, k, t);
    row[j] = wire->factor * y + wire->offset;
    if (m->plan.limits && !(fabs(row[j]) <= m->plan.limits[j])) m->beyond = true;
  }
  if (m->beyond) {
    snprintf(m->message, sizeof m->message, "what is recorded at %g s is beyond its limits", t);
    return -1;
  }
  m->rows++;
  return 0;
}

int cosim_advance(Master *m, int64_t tick, double *rows) {
  if (m->monolithic) return monolithic_advance(m->monolithic, m, tick, rows);
  while (m->tick < tick) {
    limit_stride(m, tick);
    if (step(m, &rows)) return -1;
    if (m->tick % m->plan.ticks_per_record == 0) {
      if (cosim_record(m, rows)) return -1;
      rows += m->plan.n_recorded;
    }
  }
  return 0;
}

static size_t larger(size_t a, size_t b) { return a > b ? a : b; }

static bool allocate_scratch(Master *m) {
  size_t n_real = 1, n_discretes = 1;
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    size_t n = unit->real_inputs.n, order = (size_t)unit->input_order;
    n_real = larger(n_real, larger(n, unit->real_outputs.n));
    n_discretes = larger(n_discretes, larger(unit->integer_inputs.n, unit->boolean_inputs.n));
    n_discretes = larger(n_discretes, larger(unit->integer_outputs.n, unit->boolean_outputs.n));
    n_discretes = larger(n_discretes, larger(unit->integer_watched.n, unit->boolean_watched.n));
    Scratch *scratch = &m->scratch[i];
    scratch->refs = calloc(n * order + 1, sizeof *scratch->refs);
    scratch->orders = calloc(n * order + 1, sizeof *scratch->orders);
    if (!scratch->refs || !scratch->orders) return false;
    for (size_t j = 0; j < n * order; j++) {
      scratch->refs[j] = unit->real_inputs.refs[j / order];
      scratch->orders[j] = (fmi2Integer)(j % order) + 1;
    }
  }
  m->u = calloc(n_real, sizeof *m->u);
  m->du = calloc(3 * n_real, sizeof *m->du);
  m->first_order = calloc(n_real, sizeof *m->first_order);
  m->discrete = calloc(n_discretes, sizeof *m->discrete);
  if (!m->u || !m->du || !m->first_order || !m->discrete) return false;
  for (size_t j = 0; j < n_real; j++) m->first_order[j] = 1;
  return true;
}

Master *cosim_create(const Plan *plan) {
  Master *m = calloc(1, sizeof *m);
  if (!m) return NULL;
  m->plan = *plan;
  size_t n = plan->n_outputs + 1; /* calloc(0) may be NULL */
  m->scratch = calloc(plan->n_units + 1, sizeof *m->scratch);
  m->past = calloc(n, sizeof *m->past);
  m->y = calloc(n, sizeof *m->y);
  m->dy = calloc(n, sizeof *m->dy);
  m->expected = calloc(n, sizeof *m->expected);
  m->p = calloc(n + plan->n_inputs, sizeof *m->p);
  m->work = calloc(3 * plan->n_ports + 1, sizeof *m->work);
  if (!m->scratch || !m->past || !m->y || !m->dy || !m->expected || !m->p || !m->work || !allocate_scratch(m)) {
    cosim_destroy(m);
    return NULL;
  }
  m->total = m->work + plan->n_ports;
  m->total_abs = m->total + plan->n_ports;
  if (plan->n_ordered && !(m->monolithic = monolithic_create(&m->plan))) {
    cosim_destroy(m);
    return NULL;
  }
  return m;
}

void cosim_destroy(Master *m) {
  if (!m) return;
  monolithic_destroy(m->monolithic);
  for (size_t i = 0; m->scratch && i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (m->scratch[i].state) unit->free_state(unit->component, &m->scratch[i].state);
    free(m->scratch[i].refs);
    free(m->scratch[i].orders);
  }
  free(m->scratch);
  free(m->past);
  free(m->y);
  free(m->dy);
  free(m->expected);
  free(m->p);
  free(m->work);
  free(m->u);
  free(m->du);
  free(m->first_order);
  free(m->discrete);
  free(m);
}

void cosim_works(const Master *m, double *work, double *work_abs) {
  for (size_t k = 0; k < m->plan.n_ports; k++) {
    work[k] = m->total[k];
    work_abs[k] = m->total_abs[k];
  }
}

int64_t cosim_tick(const Master *m) { return m->tick; }
int64_t cosim_rows(const Master *m) { return m->rows; }

const char *cosim_message(const Master *m) { return m->message; }

void cosim_counters(const Master *m, Counters *counters) { *counters = m->count; }
