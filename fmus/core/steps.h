/* Communication steps: polynomial inputs, the step itself, derivatives of outputs. */
#ifndef COBOT_JOINT_STEPS_H
#define COBOT_JOINT_STEPS_H

#include "core/held.h"
#include "core/life.h"

static inline Status refuse_derivative(Instance *c, Reference vr, int order, double value) {
  if (vr >= N_PUBLIC) FAIL(c, "value reference %u is no real variable; they go from 0 to %d", vr, N_PUBLIC - 1);
  if (!is_input(vr)) FAIL(c, "%s is no input", REAL_INFO[vr].name);
  if (order < 1 || order > INPUT_ORDER)
    FAIL(c, "order %d of %s; allowed are 1 to %d", order, REAL_INFO[vr].name, INPUT_ORDER);
  FAIL(c, "derivative %d of %s is %g", order, REAL_INFO[vr].name, value);
}

static inline Status set_input_derivatives(Instance *c, const Reference vr[], size_t n, const int order[],
                                           const double value[]) {
  if (n > 0) NEEDS_POINTER(vr);
  if (n > 0) NEEDS_POINTER(order);
  if (n > 0) NEEDS_POINTER(value);
  for (size_t i = 0; i < n; i++)
    if (!is_input(vr[i]) || order[i] < 1 || order[i] > INPUT_ORDER || !(fabs(value[i]) <= DBL_MAX))
      return refuse_derivative(c, vr[i], order[i], value[i]);
  Unit *m = &c->unit;
  for (size_t i = 0; i < n; i++) {
    const int j = (int)vr[i] - FIRST_INPUT;
    if (!m->u[j].fresh) begin_input(m, j, reals(m)[vr[i]]); /* a step's first derivative sets the others to zero */
    m->u[j].given = 1;
    m->u[j].c[order[i]] = value[i];
    if (value[i] != 0 && m->u[j].order < order[i]) m->u[j].order = order[i];
  }
  return OK;
}

/* dy/dt = dg/dx dx/dt + dg/du du/dt + dg/dt, by a difference along that direction */
static inline Status output_derivatives(Instance *c, const Reference vr[], size_t n, const int order[],
                                        double value[]) {
  CHECK_LIST(0, N_PUBLIC, "real");
  if (n > 0) NEEDS_POINTER(order);
  Unit *m = &c->unit;
  refresh(m);
  bool all_states = true;
  for (size_t i = 0; i < n; i++) {
    if (order[i] != 1) FAIL(c, "order %d of %s; allowed is 1", order[i], REAL_INFO[vr[i]].name);
    if (REAL_INFO[vr[i]].kind > IS_OUTPUT || REAL_INFO[vr[i]].kind == IS_INPUT)
      FAIL(c, "%s is no output", REAL_INFO[vr[i]].name);
    all_states &= (int)vr[i] < N_X;
  }
  if (all_states) {
    for (size_t i = 0; i < n; i++) value[i] = reals(m)[FIRST_DER + vr[i]];
    return OK;
  }
  const double dt = 1e-7; /* s; what is fast here changes within 1e-4 s and more */
  Unit near = *m;
  for (int i = 0; i < N_X; i++) reals(&near)[i] = reals(m)[i] + dt * reals(m)[FIRST_DER + i];
  evaluate_outputs(&near, m->time + dt);
  for (size_t i = 0; i < n; i++)
    value[i] = (int)vr[i] < N_X ? reals(m)[FIRST_DER + vr[i]] : (reals(&near)[vr[i]] - reals(m)[vr[i]]) / dt;
  return OK;
}

/* states, integrals, inputs and outputs are numbers */
static bool all_finite(const Unit *m) {
  enum { N = N_X + N_INPUT + N_OUTPUT, BESIDE = 4 }; /* sums beside each other: none waits for another */
  const double *x = reals(m);
  double zero[BESIDE] = {0}; /* x - x is 0, or not a number */
  for (int i = 0; i < N / BESIDE; i++)
    for (int k = 0; k < BESIDE; k++) zero[k] += x[BESIDE * i + k] - x[BESIDE * i + k];
  for (int i = N / BESIDE * BESIDE; i < N; i++) zero[0] += x[i] - x[i];
  return zero[0] + zero[1] + (zero[2] + zero[3]) == 0;
}

/* to t_end, or where the watch ends the step; late values of parameters as events on the way */
static const char *advance(Instance *c, double t_end, Watch *watch) {
  Unit *m = &c->unit;
  for (;;) {
    if (apply_late(&c->late, m)) m->restart = 1;
    refresh(m);
    const double stop = fmin(t_end, next_late(&c->late, m));
    const char *trouble = integrate(m, stop, watch);
    if (trouble || stop >= t_end || (watch && watch->until <= m->time)) return trouble;
  }
}

static void tell_events(const Instance *c) {
  static const char *const TEXT[N_EVENT + 1] = {
#define EVENT(name, text) text,
#include "core/rows.h"
      NULL};
  for (int k = 0; k < N_EVENT; k++) {
    const Happened *e = &c->unit.happened[k];
    if (e->count > 0) say(c, OK, "logEvents", "%s: %d times in this step, last at %.9g s", TEXT[k], e->count, e->last);
  }
}

/* Event mode: what is due happens. */
static inline Status update_discrete_states(Instance *c, bool *happened) {
  Unit *m = &c->unit;
  refresh(m);
  *happened = false;
#if defined UNIT_EVENTS
  memset(m->happened, 0, sizeof m->happened);
  if (!events_here(m)) FAIL(c, "events follow each other without end");
  time_events_here(m);
  evaluate_outputs(m, m->time);
  for (int k = 0; k < N_EVENT; k++) *happened |= m->happened[k].count > 0;
  if (c->log_events) tell_events(c);
#endif
#if defined UNIT_SAMPLED
  if (m->ticks) unit_sample(m);
#endif
  m->ticks = 0; /* FMI 3.0.2, 2.2.8: clocks become inactive here */
  return OK;
}

/* watch: NULL where the master looks at nothing within the step */
static Status do_step(Instance *c, double t, double h, Watch *watch) {
  Unit *m = &c->unit;
  const double slack = 1e-9 * fmax(1, fabs(m->time));
  if (!(h > 0) || !isfinite(h)) FAIL(c, "communicationStepSize %g; it has to be positive", h);
  if (!(fabs(t - m->time) <= slack)) FAIL(c, "currentCommunicationPoint %.12g, but the unit is at %.12g", t, m->time);
  if (t + h > c->stop_time + slack) FAIL(c, "the step ends at %g, behind the stop time %g", t + h, c->stop_time);
  refresh(m);
  memset(m->happened, 0, sizeof m->happened);
  continue_held(m, h);
  for (int j = 0; j < N_INPUT; j++) { /* an input that nobody set stays where it got to */
    if (!m->u[j].fresh) {
      m->u[j].c[0] = reals(m)[FIRST_INPUT + j];
      m->u[j].t0 = m->time;
      m->u[j].order = m->u[j].given = m->u[j].answers = 0;
    }
    m->u[j].streamed = m->u[j].fresh;
    m->u[j].fresh = 0;
  }
  const char *trouble = advance(c, t + h, watch);
  if (!all_finite(m)) FAIL(c, "from %g s by %g s: a variable left the range of numbers", t, h);
  if (c->log_events) tell_events(c);
  if (trouble) {
    c->phase = STOPPED_SHORT;
    DISCARD(c, "from %g s by %g s: %s, at %g s", t, h, trouble, m->time);
  }
  end_of_step(m, watch && watch->until < t + h);
  return OK;
}

/* Of the unknowns: outputs and derivatives of states. Of the knowns: inputs and states, and while initializing parameters. */
static bool is_unknown(Reference vr) {
  if (vr >= N_PUBLIC) return vr < N_REAL;
  return REAL_INFO[vr].kind <= IS_OUTPUT && REAL_INFO[vr].kind != IS_INPUT;
}

static bool is_known(const Instance *c, Reference vr) {
  if (vr >= N_PUBLIC) return false;
  const Kind kind = REAL_INFO[vr].kind;
  return kind == IS_INPUT || kind == IS_STATE || kind == IS_INTEGRAL ||
         (kind == IS_PARAMETER && c->phase == INITIALIZATION);
}

/* what counts as much of a variable: of a parameter its value, which may be 1e-6 or 1e6 */
static double size_of(const Unit *m, Reference vr) {
  const bool parameter = REAL_INFO[vr].kind == IS_PARAMETER && reals(m)[vr] != 0;
  return parameter ? fabs(reals(m)[vr]) : REAL_INFO[vr].nominal;
}

/* d unknown / d known . dv by a central difference, events held (FMI 2.0.4, 2.1.9 and 2.2.8: with Derivatives listed, states are
 * among the knowns and their derivatives among the unknowns of a co-simulation unit) */
static Status directional_derivative(Instance *c, const Reference unknown[], size_t n_unknown, const Reference known[],
                                     size_t n_known, const double dv[], double dz[]) {
  if (n_unknown > 0) NEEDS_POINTER(unknown);
  if (n_unknown > 0) NEEDS_POINTER(dz);
  if (n_known > 0) NEEDS_POINTER(known);
  if (n_known > 0) NEEDS_POINTER(dv);
  if (!settle(c)) FAIL(c, "events follow each other without end");
  for (size_t i = 0; i < n_unknown; i++)
    if (!is_unknown(unknown[i])) FAIL(c, "unknown %u is no real output and no derivative of a state", unknown[i]);
  double length = 0;
  bool parameters = false;
  for (size_t j = 0; j < n_known; j++) {
    if (!is_known(c, known[j]))
      FAIL(c, "known %u is no real input or state, nor a parameter of a unit that is %s", known[j],
           phase_name(INITIALIZATION));
    if (!isfinite(dv[j])) FAIL(c, "dv[%d] is not finite", (int)j);
    length = fmax(length, fabs(dv[j]) / size_of(&c->unit, known[j]));
    parameters |= REAL_INFO[known[j]].kind == IS_PARAMETER;
  }
  const double eps = length > 0 ? 1e-6 / length : 0;
  Unit near = c->unit;
  for (int j = 0; j < N_INPUT; j++) near.u[j].order = 0;
  for (int side = -1; side <= 1; side += 2) {
    for (size_t j = 0; j < n_known; j++) reals(&near)[known[j]] = reals(&c->unit)[known[j]];
    for (size_t j = 0; j < n_known; j++) reals(&near)[known[j]] += side * eps * dv[j];
    if (parameters) unit_start(&near);
    equations(&near);
    observe(&near);
    for (size_t i = 0; i < n_unknown; i++)
      dz[i] = eps == 0 ? 0 : side < 0 ? reals(&near)[unknown[i]] : (reals(&near)[unknown[i]] - dz[i]) / (2 * eps);
  }
  return OK;
}

#endif
