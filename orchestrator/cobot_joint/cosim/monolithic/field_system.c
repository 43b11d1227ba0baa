#include "monolithic/field_system.h"

#include <stdlib.h>
#include <string.h>

static const double DIFFERENCE = 3e-7; /* of what counts as much of a variable */
static const double ALONG = 1e-7;      /* s */
enum { ASK_ALL = 16 };                 /* columns that did not matter are asked again in every 16th Jacobian */

static bool add_unit(FieldSystem *s, const Unit *unit) {
  if (s->n_units == MOST_UNITS) return false;
  FieldUnit *u = &s->units[s->n_units++];
  *u = (FieldUnit){.unit = unit,
                   .field = unit->field,
                   .instance = unit->component,
                   .first = s->n,
                   .n = (size_t)unit->field->n_states};
  if (s->n + u->n > MOST_STATES || u->n + unit->real_inputs.n + 1 > MOST_COLUMNS || u->field->n_events > MOST_EVENTS)
    return false;
  for (size_t i = 0; i < u->n; i++) s->nominal[s->n + i] = u->field->nominal((int32_t)i);
  s->n += u->n;
  u->feeds = calloc(unit->real_inputs.n + 1, sizeof *u->feeds);
  u->given = calloc(unit->real_outputs.n + 1, sizeof *u->given);
  return u->feeds && u->given;
}

/* the units in the plan's order; one that comes twice is visited twice */
static bool add_units(FieldSystem *s) {
  const Plan *plan = s->plan;
  if (plan->n_ordered > 2 * MOST_UNITS) return false;
  for (size_t v = 0; v < plan->n_ordered; v++) {
    const Unit *unit = &plan->units[plan->order[v]];
    size_t k = 0;
    while (k < s->n_units && s->units[k].unit != unit) k++;
    if (k == s->n_units && !add_unit(s, unit)) return false;
    s->visits[s->n_visits++] = (Visit){(int32_t)k, true};
    for (size_t before = 0; before < v; before++)
      if (s->visits[before].unit == (int32_t)k) s->visits[before].last = false;
  }
  return true;
}

FieldSystem *system_create(const Plan *plan) {
  FieldSystem *s = calloc(1, sizeof *s);
  if (!s) return NULL;
  s->plan = plan;
  if (!add_units(s)) {
    system_destroy(s);
    return NULL;
  }
  const size_t n = plan->n_outputs + plan->n_inputs + 1;
  s->known = calloc(n, sizeof *s->known);
  s->signal = calloc(n, sizeof *s->signal);
  s->slope = calloc(n, sizeof *s->slope);
  s->gradient = calloc(n, sizeof *s->gradient);
  s->reaches = calloc(n, sizeof *s->reaches);
  if (s->known && s->signal && s->slope && s->gradient && s->reaches) return s;
  system_destroy(s);
  return NULL;
}

void system_destroy(FieldSystem *s) {
  if (!s) return;
  for (size_t k = 0; k < s->n_units; k++) {
    free(s->units[k].feeds);
    free(s->units[k].given);
  }
  free(s->known);
  free(s->signal);
  free(s->slope);
  free(s->gradient);
  free(s->reaches);
  free(s);
}

static inline bool is_state(const FieldUnit *u, fmi2ValueReference ref) { return ref < u->n; }

/* where a unit has what goes to and fro with every evaluation */
static void look_up(FieldSystem *s, FieldUnit *u) {
  const Unit *unit = u->unit;
  for (size_t i = 0; i < u->n; i++) {
    s->state[u->first + i] = u->values + i;
    s->derivative[u->first + i] = u->values + u->field->first_derivative + i;
  }
  for (size_t j = 0; j < unit->real_inputs.n; j++) {
    const Wire *wire = &unit->wires[j];
    u->feeds[j] = (Feed){u->values + unit->real_inputs.refs[j], s->signal + wire->signal, wire->factor, wire->offset};
  }
  u->n_given = 0;
  for (size_t j = 0; j < unit->real_outputs.n; j++) {
    const fmi2ValueReference ref = unit->real_outputs.refs[j];
    const Copy copy = {s->signal + unit->first_signal + j, u->values + ref};
    if (is_state(u, ref))
      s->known[s->n_known++] = copy;
    else
      u->given[u->n_given++] = copy;
  }
}

const Unit *system_begin(FieldSystem *s, double x[]) {
  s->n_known = 0;
  for (size_t k = 0; k < s->n_units; k++) {
    FieldUnit *u = &s->units[k];
    u->values = u->field->values(u->instance);
    if (!u->values) return u->unit;
    look_up(s, u);
    u->taken = false;
    memcpy(x + u->first, u->values, u->n * sizeof *x);
    for (size_t c = 0; c <= MOST_COLUMNS; c++) u->depends[c] = true;
  }
  for (size_t i = 0; i < s->n; i++) s->rows[i] = 0;
  s->rows_grew = true;
  s->asked = 0;
  s->sample = 0;
  return NULL;
}

static bool drives(const FieldSystem *s, size_t signal) {
  for (size_t k = 0; k < s->n_units; k++)
    for (size_t j = 0; j < s->units[k].unit->real_inputs.n; j++)
      if ((size_t)s->units[k].unit->wires[j].signal == signal) return true;
  return false;
}

bool system_gives(const FieldUnit *u, size_t j, double t) {
  if (is_state(u, u->unit->real_outputs.refs[j])) return true;
  double *y = u->values + u->unit->real_outputs.refs[j];
  const double before = *y;
  *y = NAN;
  u->field->evaluate(u->instance, t);
  const bool given = !isnan(*y);
  if (!given) *y = before;
  return given;
}

const Unit *system_unfit(FieldSystem *s, double t) {
  for (size_t k = 0; k < s->n_units; k++)
    for (size_t j = 0; j < s->units[k].unit->real_outputs.n; j++)
      if (drives(s, (size_t)s->units[k].unit->first_signal + j) && !system_gives(&s->units[k], j, t))
        return s->units[k].unit;
  return NULL;
}

/* inputs of the system: linear between samples, or held; held outside; their slopes besides */
static void read_samples(FieldSystem *s, double t) {
  const Plan *p = s->plan;
  if (p->n_inputs == 0) return;
  while (s->sample > 0 && p->sample_time[s->sample] > t) s->sample--;
  while (s->sample + 1 < p->n_samples && p->sample_time[s->sample + 1] <= t) s->sample++;
  const size_t k = s->sample;
  const bool inside = t >= p->sample_time[0] && k + 1 < p->n_samples;
  const double dt = inside ? p->sample_time[k + 1] - p->sample_time[k] : 1;
  while (s->held > 0 && p->sample_time[s->held] > s->since + AT_TICK * p->step) s->held--;
  while (s->held + 1 < p->n_samples && p->sample_time[s->held + 1] <= s->since + AT_TICK * p->step) s->held++;
  for (size_t j = 0; j < p->n_inputs; j++) {
    const double *y = p->samples + j * p->n_samples;
    if (p->held[j]) {
      s->signal[p->n_outputs + j] = y[s->held];
      s->slope[p->n_outputs + j] = 0;
      continue;
    }
    const double slope = inside ? (y[k + 1] - y[k]) / dt : 0;
    s->signal[p->n_outputs + j] = y[k] + (inside ? slope * (t - p->sample_time[k]) : 0);
    s->slope[p->n_outputs + j] = slope;
  }
}

static inline void go_to(FieldSystem *s, double t, const double x[]) {
  read_samples(s, t);
  for (size_t i = 0; i < s->n; i++) *s->state[i] = x[i];
  for (size_t k = 0; k < s->n_known; k++) *s->known[k].to = *s->known[k].from; /* before any unit is asked */
}

static inline void visit(const FieldUnit *u, double t) {
  for (size_t j = 0; j < u->unit->real_inputs.n; j++)
    *u->feeds[j].to = u->feeds[j].factor * *u->feeds[j].from + u->feeds[j].offset;
  u->field->evaluate(u->instance, t);
  for (size_t j = 0; j < u->n_given; j++) *u->given[j].to = *u->given[j].from;
}

void system_evaluate(FieldSystem *s, double t, const double x[], double f[]) {
  go_to(s, t, x);
  for (size_t v = 0; v < s->n_visits; v++) visit(&s->units[s->visits[v].unit], t);
  for (size_t i = 0; i < s->n; i++) f[i] = *s->derivative[i];
}

void system_look(FieldSystem *s, double t, const double x[]) {
  go_to(s, t, x);
  for (size_t v = 0; v < s->n_visits; v++)
    if (s->units[s->visits[v].unit].taken) visit(&s->units[s->visits[v].unit], t);
}

void system_take_unit(FieldSystem *s, FieldUnit *u) {
  if (u->taken) return;
  u->taken = true;
  for (size_t j = 0; j < u->unit->real_inputs.n; j++) system_take(s, (size_t)u->unit->wires[j].signal);
}

void system_take(FieldSystem *s, size_t signal) {
  for (size_t k = 0; k < s->n_units; k++) {
    FieldUnit *u = &s->units[k];
    const size_t first = (size_t)u->unit->first_signal, n = u->unit->real_outputs.n;
    if (signal < first || signal >= first + n) continue;
    if (!is_state(u, u->unit->real_outputs.refs[signal - first])) system_take_unit(s, u);
  }
}

/* One column of a unit: derivatives and outputs by a variable of its own, or the time. false: nothing depends on it. */
static bool differentiate(const FieldSystem *s, const FieldUnit *u, double t, double *variable, double step,
                          const double f[], double by[]) {
  const Unit *unit = u->unit;
  const double before = variable ? *variable : t, *der = u->values + u->field->first_derivative;
  const double *y = s->signal + unit->first_signal, after = before + step;
  bool any = false;
  if (variable) *variable = after;
  u->field->evaluate(u->instance, variable ? t : after);
  for (size_t i = 0; i < u->n; i++) by[i] = (der[i] - f[u->first + i]) / (after - before);
  for (size_t j = 0; j < unit->real_outputs.n; j++)
    by[u->n + j] = (u->values[unit->real_outputs.refs[j]] - y[j]) / (after - before);
  for (size_t i = 0; i < u->n + unit->real_outputs.n; i++) any |= by[i] != 0;
  if (variable) *variable = before;
  return any;
}

/* adds what a unit's derivatives and outputs owe to one of its variables, whose own gradient and slope are known */
static void chain(FieldSystem *s, const FieldUnit *u, bool last, const double by[], const double gradient[],
                  uint64_t reaches, double slope, double J[][MOST_STATES], double f_t[]) {
  const size_t first = (size_t)u->unit->first_signal;
  for (size_t i = 0; i < u->n + u->unit->real_outputs.n; i++) {
    if (by[i] == 0 || (i < u->n && !last)) continue;
    double *row = i < u->n ? J[u->first + i] : s->gradient[first + i - u->n];
    uint64_t *mask = i < u->n ? &s->rows[u->first + i] : &s->reaches[first + i - u->n];
    *(i < u->n ? &f_t[u->first + i] : &s->slope[first + i - u->n]) += by[i] * slope;
    for (EACH(k, reaches)) row[lowest_bit(k)] += by[i] * gradient[lowest_bit(k)];
    if (reaches & ~*mask) {
      *mask |= reaches;
      s->rows_grew |= i < u->n;
    }
  }
}

/* what counts as much of an input: an angle goes far, and what follows from it does not grow with it */
static double size_of_input(const FieldSystem *s, const Wire *wire, double value) {
  const bool own = (size_t)wire->signal < s->plan->n_outputs;
  return own ? fabs(wire->factor) * s->plan->nominal[wire->signal] : fmax(1e-3, fabs(value));
}

static void unit_jacobian(FieldSystem *s, Visit visit, double t, const double f[], bool all, double J[][MOST_STATES],
                          double f_t[]) {
  FieldUnit *u = &s->units[visit.unit];
  const Unit *unit = u->unit;
  const bool last = visit.last;
  double by[2 * MOST_STATES + MOST_COLUMNS], own[MOST_STATES] = {0};
  for (size_t j = 0; j < unit->real_outputs.n; j++) { /* outputs that are states were known before */
    const size_t k = (size_t)unit->first_signal + j;
    if (is_state(u, unit->real_outputs.refs[j])) continue;
    memset(s->gradient[k], 0, s->n * sizeof(double));
    s->reaches[k] = 0;
    s->slope[k] = 0;
  }
  for (size_t c = 0; c <= u->n + unit->real_inputs.n; c++) {
    if (!all && !u->depends[c]) continue;
    const bool state = c < u->n, timed = c == u->n + unit->real_inputs.n;
    const Wire *wire = state || timed ? NULL : &unit->wires[c - u->n];
    double *variable = state ? u->values + c : timed ? NULL : u->values + unit->real_inputs.refs[c - u->n];
    const double size = state ? s->nominal[u->first + c] : timed ? 1 : size_of_input(s, wire, *variable);
    u->depends[c] = differentiate(s, u, t, variable, DIFFERENCE * size, f, by);
    if (!u->depends[c]) continue;
    for (size_t j = 0; j < unit->real_outputs.n; j++)
      if (is_state(u, unit->real_outputs.refs[j])) by[u->n + j] = 0;
    if (state) {
      own[u->first + c] = 1;
      chain(s, u, last, by, own, bit(u->first + c), 0, J, f_t);
      own[u->first + c] = 0;
    } else if (timed) {
      chain(s, u, last, by, own, 0, 1, J, f_t);
    } else {
      double through[MOST_STATES];
      const uint64_t reaches = s->reaches[wire->signal];
      for (EACH(k, reaches)) through[lowest_bit(k)] = wire->factor * s->gradient[wire->signal][lowest_bit(k)];
      chain(s, u, last, by, through, reaches, wire->factor * s->slope[wire->signal], J, f_t);
    }
  }
}

/* Along the motion itself J f is known much better than from its columns: there angles on both sides of a gear, thousands of
 * radians, cancel to a twist of 1e-6. In every row the entry that carries most of it takes the difference. */
static void exact_along(FieldSystem *s, double t, const double x[], const double f[], double J[][MOST_STATES]) {
  double at[MOST_STATES], ahead[MOST_STATES], behind[MOST_STATES];
  for (size_t i = 0; i < s->n; i++) at[i] = x[i] + ALONG * f[i];
  system_evaluate(s, t, at, ahead);
  for (size_t i = 0; i < s->n; i++) at[i] = x[i] - ALONG * f[i];
  system_evaluate(s, t, at, behind);
  for (size_t i = 0; i < s->n; i++) {
    double off = (ahead[i] - behind[i]) / (2 * ALONG), most = 0;
    size_t carrier = i;
    for (EACH(k, s->rows[i])) {
      const size_t j = lowest_bit(k);
      const double part = J[i][j] * f[j];
      off -= part;
      if (fabs(part) > most) most = fabs(part), carrier = j;
    }
    if (most > 0) J[i][carrier] += off / f[carrier];
  }
}

void system_jacobian(FieldSystem *s, double t, const double x[], const double f[], double J[][MOST_STATES],
                     double f_t[]) {
  const bool all = s->asked++ % ASK_ALL == 0;
  for (size_t i = 0; i < s->n; i++) {
    memset(J[i], 0, s->n * sizeof(double));
    f_t[i] = 0;
  }
  for (size_t k = 0; k < s->n_units; k++) {
    const FieldUnit *u = &s->units[k];
    for (size_t j = 0; j < u->unit->real_outputs.n; j++) {
      const fmi2ValueReference ref = u->unit->real_outputs.refs[j];
      if (!is_state(u, ref)) continue;
      const size_t signal = (size_t)u->unit->first_signal + j;
      s->gradient[signal][u->first + ref] = 1;
      s->reaches[signal] = bit(u->first + ref);
      s->slope[signal] = 0;
    }
  }
  for (size_t v = 0; v < s->n_visits; v++) unit_jacobian(s, s->visits[v], t, f, all, J, f_t);
  exact_along(s, t, x, f, J);
}

double system_indicator(FieldSystem *s) {
  double z[MOST_EVENTS], largest = -INFINITY;
  for (size_t k = 0; k < s->n_units; k++) {
    const FieldUnit *u = &s->units[k];
    if (u->field->n_events == 0) continue;
    u->field->indicators(u->instance, z);
    for (int32_t j = 0; j < u->field->n_events; j++) largest = z[j] > largest ? z[j] : largest;
  }
  return largest;
}

int system_happen(FieldSystem *s, double t, double x[]) {
  for (size_t k = 0; k < s->n_units; k++) {
    const FieldUnit *u = &s->units[k];
    if (u->field->happen(u->instance, t)) return -1;
    memcpy(x + u->first, u->values, u->n * sizeof *x);
  }
  return 0;
}

double system_next_event(const FieldSystem *s) {
  double next = INFINITY;
  for (size_t k = 0; k < s->n_units; k++) next = fmin(next, s->units[k].field->next_event(s->units[k].instance));
  return next;
}
