/* Communication steps: polynomial inputs, fmi2DoStep, derivatives of outputs, status. */
#ifndef COBOT_JOINT_STEPS_H
#define COBOT_JOINT_STEPS_H

#include "fmi2/held.h"
#include "fmi2/instance.h"

static fmi2Status refuse_derivative(Instance *c, fmi2ValueReference vr, int order, double value) {
  if (vr >= N_PUBLIC)
    FAIL(c, "fmi2SetRealInputDerivatives: value reference %u is no real variable; they go from 0 to %d", vr,
         N_PUBLIC - 1);
  if (!is_input(vr)) FAIL(c, "fmi2SetRealInputDerivatives: %s is no input", REAL_INFO[vr].name);
  if (order < 1 || order > INPUT_ORDER)
    FAIL(c, "fmi2SetRealInputDerivatives: order %d of %s; allowed are 1 to %d", order, REAL_INFO[vr].name, INPUT_ORDER);
  FAIL(c, "fmi2SetRealInputDerivatives: derivative %d of %s is %g", order, REAL_INFO[vr].name, value);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
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
  return fmi2OK;
}

/* dy/dt = dg/dx dx/dt + dg/du du/dt + dg/dt, by a difference along that direction */
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  NEEDS(STEPPING | TERMINATED | STOPPED_SHORT);
  CHECK_LIST(0, N_PUBLIC, "real");
  if (n > 0) NEEDS_POINTER(order);
  Unit *m = &c->unit;
  refresh(m);
  bool all_states = true;
  for (size_t i = 0; i < n; i++) {
    if (order[i] != 1)
      FAIL(c, "fmi2GetRealOutputDerivatives: order %d of %s; allowed is 1", order[i], REAL_INFO[vr[i]].name);
    if (REAL_INFO[vr[i]].kind > IS_OUTPUT || REAL_INFO[vr[i]].kind == IS_INPUT)
      FAIL(c, "fmi2GetRealOutputDerivatives: %s is no output", REAL_INFO[vr[i]].name);
    all_states &= (int)vr[i] < N_X;
  }
  if (all_states) {
    for (size_t i = 0; i < n; i++) value[i] = reals(m)[FIRST_DER + vr[i]];
    return fmi2OK;
  }
  const double dt = 1e-7; /* s; what is fast here changes within 1e-4 s and more */
  Unit near = *m;
  for (int i = 0; i < N_X; i++) reals(&near)[i] = reals(m)[i] + dt * reals(m)[FIRST_DER + i];
  evaluate_outputs(&near, m->time + dt);
  for (size_t i = 0; i < n; i++)
    value[i] = (int)vr[i] < N_X ? reals(m)[FIRST_DER + vr[i]] : (reals(&near)[vr[i]] - reals(m)[vr[i]]) / dt;
  return fmi2OK;
}

/* states, integrals, inputs and outputs are numbers */
static bool all_finite(const Unit *m) {
  bool lost = false;
  for (int i = 0; i < N_X + N_INPUT + N_OUTPUT; i++) lost |= !(fabs(reals(m)[i]) <= DBL_MAX);
  return !lost;
}

/* to t_end, late values of parameters as events on the way */
static const char *advance(Instance *c, double t_end) {
  Unit *m = &c->unit;
  for (;;) {
    if (apply_late(&c->late, m)) m->restart = 1;
    refresh(m);
    const double stop = fmin(t_end, next_late(&c->late, m));
    const char *trouble = integrate(m, stop);
    if (trouble || stop >= t_end) return trouble;
  }
}

static void tell_events(const Instance *c) {
  static const char *const TEXT[N_EVENT + 1] = {
#define EVENT(name, text) text,
#include "fmi2/rows.h"
      NULL};
  for (int k = 0; k < N_EVENT; k++) {
    const Happened *e = &c->unit.happened[k];
    if (e->count > 0)
      say(c, fmi2OK, "logEvents", "%s: %d times in this step, last at %.9g s", TEXT[k], e->count, e->last);
  }
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean no_rollback) {
  NEEDS(STEPPING);
  (void)no_rollback;
  Unit *m = &c->unit;
  const double slack = 1e-9 * fmax(1, fabs(m->time));
  if (!(h > 0) || !isfinite(h)) FAIL(c, "fmi2DoStep: communicationStepSize %g; it has to be positive", h);
  if (!(fabs(t - m->time) <= slack))
    FAIL(c, "fmi2DoStep: currentCommunicationPoint %.12g, but the unit is at %.12g", t, m->time);
  if (t + h > c->stop_time + slack)
    FAIL(c, "fmi2DoStep: the step ends at %g, behind the stop time %g", t + h, c->stop_time);
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
  const char *trouble = advance(c, t + h);
  if (!all_finite(m)) FAIL(c, "fmi2DoStep: from %g s by %g s: a variable left the range of numbers", t, h);
  if (c->log_events) tell_events(c);
  if (trouble) {
    c->phase = STOPPED_SHORT;
    DISCARD(c, "fmi2DoStep: from %g s by %g s: %s, at %g s", t, h, trouble, m->time);
  }
  end_of_step(m);
  return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component) {
  NEEDS(ANY);
  FAIL(c, "fmi2CancelStep: steps are finished when fmi2DoStep returns");
}

#define STATUS(type)                                                                                                   \
  fmi2Status fmi2Get##type##Status(fmi2Component component, const fmi2StatusKind kind, fmi2##type *value) {            \
    NEEDS(ANY);                                                                                                        \
    (void)value;                                                                                                       \
    DISCARD(c, "fmi2Get" #type "Status: no status %d; steps are finished when fmi2DoStep returns", (int)kind);         \
  }
fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
  NEEDS(ANY);
  (void)value;
  DISCARD(c, "fmi2GetStatus: no status %d; steps are finished when fmi2DoStep returns", (int)kind);
}
STATUS(Integer)
STATUS(String)
/* a unit never wants a simulation to end: a step that it could not finish is the master's to judge */
fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
  NEEDS(ANY);
  NEEDS_POINTER(value);
  if (kind != fmi2Terminated) DISCARD(c, "fmi2GetBooleanStatus: status %d; there is fmi2Terminated", (int)kind);
  *value = fmi2False;
  return fmi2OK;
}
fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
  NEEDS(STEPPING | TERMINATED | FAILED | STOPPED_SHORT);
  NEEDS_POINTER(value);
  if (kind != fmi2LastSuccessfulTime)
    DISCARD(c, "fmi2GetRealStatus: status %d; there is fmi2LastSuccessfulTime", (int)kind);
  *value = c->unit.time;
  return fmi2OK;
}

/* Of the unknowns: outputs and derivatives of states. Of the knowns: inputs and states, and while initializing parameters. */
static bool is_unknown(fmi2ValueReference vr) {
  if (vr >= N_PUBLIC) return vr < FIRST_DER + N_STATE;
  return REAL_INFO[vr].kind <= IS_OUTPUT && REAL_INFO[vr].kind != IS_INPUT;
}

static bool is_known(const Instance *c, fmi2ValueReference vr) {
  if (vr >= N_PUBLIC) return false;
  const Kind kind = REAL_INFO[vr].kind;
  return kind == IS_INPUT || kind == IS_STATE || (kind == IS_PARAMETER && c->phase == INITIALIZATION);
}

/* what counts as much of a variable: of a parameter its value, which may be 1e-6 or 1e6 */
static double size_of(const Unit *m, fmi2ValueReference vr) {
  const bool parameter = REAL_INFO[vr].kind == IS_PARAMETER && reals(m)[vr] != 0;
  return parameter ? fabs(reals(m)[vr]) : REAL_INFO[vr].nominal;
}

/* d unknown / d known . dv by a central difference, events held (FMI 2.0.4, 2.1.9 and 2.2.8: with Derivatives listed, states are
 * among the knowns and their derivatives among the unknowns of a co-simulation unit) */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real dv[],
                                        fmi2Real dz[]) {
  NEEDS(INITIALIZATION | STEPPING | TERMINATED | STOPPED_SHORT);
  if (n_unknown > 0) NEEDS_POINTER(unknown);
  if (n_unknown > 0) NEEDS_POINTER(dz);
  if (n_known > 0) NEEDS_POINTER(known);
  if (n_known > 0) NEEDS_POINTER(dv);
  if (!settle(c)) FAIL(c, "fmi2GetDirectionalDerivative: events follow each other without end");
  for (size_t i = 0; i < n_unknown; i++)
    if (!is_unknown(unknown[i]))
      FAIL(c, "fmi2GetDirectionalDerivative: unknown %u is no real output and no derivative of a state", unknown[i]);
  double length = 0;
  bool parameters = false;
  for (size_t j = 0; j < n_known; j++) {
    if (!is_known(c, known[j]))
      FAIL(c, "fmi2GetDirectionalDerivative: known %u is no real input or state, nor a parameter of a unit that is %s",
           known[j], PHASE_NAME[INITIALIZATION]);
    if (!isfinite(dv[j])) FAIL(c, "fmi2GetDirectionalDerivative: dv[%d] is not finite", (int)j);
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
    for (size_t i = 0; i < n_unknown; i++)
      dz[i] = eps == 0 ? 0 : side < 0 ? reals(&near)[unknown[i]] : (reals(&near)[unknown[i]] - dz[i]) / (2 * eps);
  }
  return fmi2OK;
}

#endif
