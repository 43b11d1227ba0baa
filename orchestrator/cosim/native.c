/* The master algorithm: one loop for every scheme; what differs is data (schemes.py says what the fields mean).
 *
 * A step: continue every signal from its past; let each unit step on its inputs' polynomials; where the scheme is sequential, later
 * units see what earlier ones have just computed, interpolated. With several sweeps the step is repeated from the saved states on
 * the interpolants until what feeds back no longer moves; an adaptive scheme repeats it shorter where the continuation was off.
 * reference.py is the same in plain FMPy, operation by operation, so that both give the same bits.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cosim.h"
#include "signals.h"

enum { MAX_ORDER = 3 };

typedef struct { /* what one unit needs beside its description: where its inputs' derivatives go */
  fmi2ValueReference *refs;
  fmi2Integer *orders; /* [n][input_order]: 1..input_order */
  fmi2FMUstate state;
} Scratch;

struct Master {
  Plan plan;
  Scratch *scratch;         /* [n_units] */
  Past *past;               /* [n_outputs] */
  double *y, *dy;           /* [n_outputs]: at the end of the step under way */
  double *expected;         /* [n_outputs]: what readers took for y */
  Polynomial *p;            /* [n_outputs + n_inputs] */
  double *u, *du;           /* inputs of one unit and their derivatives */
  fmi2Integer *first_order; /* 1, 1, .. */
  int *discrete;            /* Integers and Booleans of one unit */
  int64_t tick, stride;
  size_t sample; /* sample_time[sample] <= t < sample_time[sample + 1] */
  int known;     /* points in the past, the present one included */
  double h_prev, h_prev2;
  Counters count;
  char message[512];
};

static double time_of(const Master *m, int64_t tick) { return m->plan.start_time + (double)tick * m->plan.step; }

/* Statuses ------------------------------------------------------------------------------------------------------------------ */

static const char *word(fmi2Status status) {
  static const char *const words[] = {"ok", "warning", "discard", "error", "fatal", "pending"};
  return status >= fmi2OK && status <= fmi2Pending ? words[status] : "an unknown status";
}

static int fail(Master *m, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(m->message, sizeof m->message, format, arguments);
  va_end(arguments);
  return -1;
}

/* 0: go on; -1: the message says which unit, which call, at what time */
static inline int check(Master *m, const Unit *unit, const char *call, fmi2Status status) {
  if (status == fmi2OK) return 0;
  if (status == fmi2Warning) {
    m->count.warnings++;
    return 0;
  }
  return fail(m, "%s: %s returned %s at t = %.9g s", unit->name, call, word(status), time_of(m, m->tick));
}

/* One unit ------------------------------------------------------------------------------------------------------------------ */

static inline Polynomial through(const Master *m, const Wire *wire) {
  Polynomial p = m->p[wire->signal];
  for (int k = 0; k <= MAX_ORDER; k++) p.a[k] *= wire->factor;
  p.a[0] += wire->offset;
  return p;
}

static int set_real_inputs(Master *m, const Unit *unit, const Scratch *scratch, double h) {
  size_t n = unit->real_inputs.n;
  if (n == 0) return 0;
  double at = unit->input_order > 0 ? 0 : unit->holds_end ? h : 0.5 * h;
  for (size_t j = 0; j < n; j++) {
    Polynomial p = through(m, &unit->wires[j]);
    m->u[j] = value(&p, at);
    if (unit->input_order == 1) {
      m->du[j] = (value(&p, h) - p.a[0]) / h;
    } else if (unit->input_order == 3) {
      m->du[3 * j] = p.a[1];
      m->du[3 * j + 1] = 2 * p.a[2];
      m->du[3 * j + 2] = 6 * p.a[3];
    }
  }
  if (check(m, unit, "fmi2SetReal", unit->set_real(unit->component, unit->real_inputs.refs, n, m->u))) return -1;
  if (unit->input_order == 0) return 0;
  size_t n_derivatives = n * (size_t)unit->input_order;
  return check(m, unit, "fmi2SetRealInputDerivatives",
               unit->set_real_input_derivatives(unit->component, scratch->refs, n_derivatives, scratch->orders, m->du));
}

/* Integers and Booleans: the value at the step's begin, or the one just computed by a unit before */
static int set_discrete_inputs(Master *m, const Unit *unit) {
  const Wire *wires = unit->wires + unit->real_inputs.n;
  for (size_t j = 0; j < unit->integer_inputs.n; j++) m->discrete[j] = (int)lround(m->p[wires[j].signal].a[0]);
  if (unit->integer_inputs.n &&
      check(m, unit, "fmi2SetInteger",
            unit->set_integer(unit->component, unit->integer_inputs.refs, unit->integer_inputs.n, m->discrete)))
    return -1;
  wires += unit->integer_inputs.n;
  for (size_t j = 0; j < unit->boolean_inputs.n; j++) m->discrete[j] = m->p[wires[j].signal].a[0] >= 0.5;
  if (unit->boolean_inputs.n &&
      check(m, unit, "fmi2SetBoolean",
            unit->set_boolean(unit->component, unit->boolean_inputs.refs, unit->boolean_inputs.n, m->discrete)))
    return -1;
  return 0;
}

static int get_values(Master *m, const Unit *unit, const Variables *real, const Variables *integer,
                      const Variables *boolean, double *y) {
  if (real->n && check(m, unit, "fmi2GetReal", unit->get_real(unit->component, real->refs, real->n, y))) return -1;
  y += real->n;
  if (integer->n) {
    if (check(m, unit, "fmi2GetInteger", unit->get_integer(unit->component, integer->refs, integer->n, m->discrete)))
      return -1;
    for (size_t j = 0; j < integer->n; j++) y[j] = m->discrete[j];
    y += integer->n;
  }
  if (boolean->n) {
    if (check(m, unit, "fmi2GetBoolean", unit->get_boolean(unit->component, boolean->refs, boolean->n, m->discrete)))
      return -1;
    for (size_t j = 0; j < boolean->n; j++) y[j] = m->discrete[j] != fmi2False;
  }
  return 0;
}

static int get_outputs(Master *m, const Unit *unit) {
  return get_values(m, unit, &unit->real_outputs, &unit->integer_outputs, &unit->boolean_outputs,
                    m->y + unit->first_signal);
}

static int get_slopes(Master *m, const Unit *unit) {
  size_t n = unit->real_outputs.n;
  if (!unit->output_derivatives || n == 0) return 0;
  return check(m, unit, "fmi2GetRealOutputDerivatives",
               unit->get_real_output_derivatives(unit->component, unit->real_outputs.refs, n, m->first_order,
                                                 m->dy + unit->first_signal));
}

static int step_unit(Master *m, size_t i, double t, double h) {
  const Unit *unit = &m->plan.units[i];
  bool keeps_history = m->plan.scheme.sweeps > 1 || m->plan.scheme.adaptive;
  if (set_real_inputs(m, unit, &m->scratch[i], h) || set_discrete_inputs(m, unit)) return -1;
  fmi2Status status = unit->do_step(unit->component, t, h, keeps_history ? fmi2False : fmi2True);
  if (status != fmi2OK && status != fmi2Warning)
    return fail(m, "%s: fmi2DoStep returned %s at t = %.9g s, step %.9g s", unit->name, word(status), t, h);
  m->count.warnings += status == fmi2Warning;
  return get_outputs(m, unit) || get_slopes(m, unit) ? -1 : 0;
}

/* Signals ------------------------------------------------------------------------------------------------------------------- */

static size_t n_discrete(const Unit *unit) { return unit->integer_outputs.n + unit->boolean_outputs.n; }

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
  bool cubic = m->plan.scheme.interpolation == 3 && unit->output_derivatives && m->known >= 2;
  size_t s = (size_t)unit->first_signal, end = s + unit->real_outputs.n;
  for (; s < end; s++)
    m->p[s] = cubic ? hermite(m->past[s].y, m->past[s].dy, m->y[s], m->dy[s], h) : line(m->past[s].y, m->y[s], h);
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

/* The system's inputs: the chord over the step, exact where no sample lies inside */
static void follow_inputs(Master *m, double t, double t_end, double h) {
  if (m->plan.n_inputs == 0) return;
  m->sample = sample_before(m, m->sample, t);
  size_t k_end = sample_before(m, m->sample, t_end);
  for (size_t j = 0; j < m->plan.n_inputs; j++) {
    const double *samples = m->plan.samples + j * m->plan.n_samples;
    m->p[m->plan.n_outputs + j] = line(sample_at(m, samples, m->sample, t), sample_at(m, samples, k_end, t_end), h);
  }
}

/* How far off the readers' expectation was, in units of the tolerance; then they expect what came out. */
static double coupling_error(Master *m) {
  double worst = 0;
  for (size_t s = 0; s < m->plan.n_outputs; s++) {
    if (!m->plan.feedback[s]) continue;
    double allowed = m->plan.scheme.tolerance * (m->plan.nominal[s] + fabs(m->y[s]));
    double error = fabs(m->y[s] - m->expected[s]) / allowed;
    if (!(error <= worst)) worst = error; /* NaN counts as worst */
    m->expected[s] = m->y[s];
  }
  return worst;
}

/* Steps --------------------------------------------------------------------------------------------------------------------- */

static int save_states(Master *m) {
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (check(m, unit, "fmi2GetFMUstate", unit->get_state(unit->component, &m->scratch[i].state))) return -1;
  }
  return 0;
}

static int restore_states(Master *m) {
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (check(m, unit, "fmi2SetFMUstate", unit->set_state(unit->component, m->scratch[i].state))) return -1;
  }
  return 0;
}

static int sweep(Master *m, double t, double h) {
  m->count.sweeps++;
  for (size_t i = 0; i < m->plan.n_units; i++) {
    if (step_unit(m, i, t, h)) return -1;
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
  m->h_prev2 = m->h_prev;
  m->h_prev = h;
  m->known += m->known < 3;
  m->tick += m->stride;
  m->count.steps++;
}

/* The next stride: the error grows with the power extrapolation + 1 of the step; strides are powers of two, aligned to themselves. */
static void choose_stride(Master *m, double error) {
  double room = pow(2.0, m->plan.scheme.extrapolation + 1);
  if (error * room < 0.5 && 2 * m->stride <= m->plan.max_stride && m->tick % (2 * m->stride) == 0) m->stride *= 2;
}

static int step(Master *m) {
  const Scheme *scheme = &m->plan.scheme;
  if ((scheme->sweeps > 1 || scheme->adaptive) && save_states(m)) return -1;
  double t = time_of(m, m->tick), error = 0;
  for (;;) {
    double h = (double)m->stride * m->plan.step;
    for (size_t i = 0; i < m->plan.n_units; i++) extrapolate(m, &m->plan.units[i], h);
    follow_inputs(m, t, time_of(m, m->tick + m->stride), h);
    if (sweep(m, t, h)) return -1;
    for (int k = 1; k < scheme->sweeps && coupling_error(m) > 1; k++) {
      if (!scheme->sequential)
        for (size_t i = 0; i < m->plan.n_units; i++) interpolate(m, &m->plan.units[i], h);
      if (restore_states(m) || sweep(m, t, h)) return -1;
    }
    if (!scheme->adaptive) break;
    error = coupling_error(m);
    if (error <= 1 || m->stride == 1) break;
    if (restore_states(m)) return -1;
    m->stride /= 2;
    m->count.rejected++;
  }
  accept(m, (double)m->stride * m->plan.step);
  if (scheme->adaptive) choose_stride(m, error);
  return 0;
}

/* Calls from Python --------------------------------------------------------------------------------------------------------- */

int cosim_begin(Master *m, int64_t tick) {
  m->tick = tick;
  m->stride = 1;
  m->known = 1;
  if (tick == 0) m->count = (Counters){0};
  m->sample = m->plan.n_samples ? sample_before(m, 0, time_of(m, tick)) : 0;
  for (size_t i = 0; i < m->plan.n_units; i++)
    if (get_outputs(m, &m->plan.units[i])) return -1;
  for (size_t s = 0; s < m->plan.n_outputs; s++) m->past[s] = (Past){.y = m->y[s]};
  return 0;
}

int cosim_record(Master *m, double *row) {
  double t = time_of(m, m->tick);
  size_t k = m->plan.n_inputs ? sample_before(m, m->sample, t) : 0;
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    double *y = m->y + (size_t)unit->first_signal + unit->real_outputs.n + n_discrete(unit);
    if (get_values(m, unit, &unit->real_watched, &unit->integer_watched, &unit->boolean_watched, y)) return -1;
  }
  for (size_t j = 0; j < m->plan.n_recorded; j++) {
    const Wire *wire = &m->plan.recorded[j];
    size_t s = (size_t)wire->signal;
    double y = s < m->plan.n_outputs
                   ? m->y[s]
                   : sample_at(m, m->plan.samples + (s - m->plan.n_outputs) * m->plan.n_samples, k, t);
    row[j] = wire->factor * y + wire->offset;
  }
  return 0;
}

int cosim_advance(Master *m, int64_t tick, double *rows) {
  while (m->tick < tick) {
    while (m->stride > tick - m->tick) m->stride /= 2;
    if (step(m)) return -1;
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
  m->du = calloc(MAX_ORDER * n_real, sizeof *m->du);
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
  if (!m->scratch || !m->past || !m->y || !m->dy || !m->expected || !m->p || !allocate_scratch(m)) {
    cosim_destroy(m);
    return NULL;
  }
  return m;
}

void cosim_destroy(Master *m) {
  if (!m) return;
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
  free(m->u);
  free(m->du);
  free(m->first_order);
  free(m->discrete);
  free(m);
}

const char *cosim_message(const Master *m) { return m->message; }

void cosim_counters(const Master *m, Counters *counters) { *counters = m->count; }
