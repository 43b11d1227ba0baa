/* Get and set: every reference and value is checked before anything changes. */
#ifndef COBOT_JOINT_VARIABLES_H
#define COBOT_JOINT_VARIABLES_H

#include "fmi2/instance.h"

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  NEEDS(READABLE);
  CHECK_LIST(0, FIRST_DER + N_STATE, "real");
  if ((c->phase & (INITIALIZATION | STEPPING)) && !settle(c))
    FAIL(c, "fmi2GetReal: events follow each other without end");
  for (size_t i = 0; i < n; i++) value[i] = reals(&c->unit)[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  NEEDS(READABLE);
  CHECK_LIST(1, N_INTEGER, "integer");
  if ((c->phase & (INITIALIZATION | STEPPING)) && !settle(c))
    FAIL(c, "fmi2GetInteger: events follow each other without end");
  for (size_t i = 0; i < n; i++) value[i] = integers(&c->unit)[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
  NEEDS(READABLE);
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  if ((c->phase & (INITIALIZATION | STEPPING)) && !settle(c))
    FAIL(c, "fmi2GetBoolean: events follow each other without end");
  for (size_t i = 0; i < n; i++) value[i] = booleans(&c->unit)[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
  NEEDS(READABLE);
  (void)value;
  if (n > 0) FAIL(c, "fmi2GetString: value reference %u: this unit has no string variables", vr ? vr[0] : 0);
  return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
  NEEDS(ANY);
  (void)value;
  if (n > 0) FAIL(c, "fmi2SetString: value reference %u: this unit has no string variables", vr ? vr[0] : 0);
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(0, N_PUBLIC, "real");
  char name[NAME_SIZE];
  for (size_t i = 0; i < n; i++) { /* all or nothing */
    if (is_input(vr[i]) && isfinite(value[i]) && !BOUNDS_INFO[vr[i]].given) continue;
    const RealInfo *r = &REAL_INFO[vr[i]];
    if (r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL || r->kind == IS_LOCAL)
      FAIL(c, "fmi2SetReal: %s is calculated by the unit and cannot be set", r->name);
    if (r->kind == IS_STATE && c->phase == STEPPING)
      FAIL(c, "fmi2SetReal: %s is a state; its start value can only be set before the initialization ends", r->name);
    if (!isfinite(value[i]))
      DISCARD(c, "fmi2SetReal: %s = %g is not finite", full_name(name, r->term, r->name), value[i]);
    if (value[i] < lowest(vr[i]) || value[i] > highest(vr[i]))
      DISCARD(c, "fmi2SetReal: %s = %g %s is outside %g to %g", full_name(name, r->term, r->name), value[i], r->unit,
              lowest(vr[i]), highest(vr[i]));
    if (FIXED_INFO[vr[i]] && c->phase == STEPPING)
      FAIL(c, "fmi2SetReal: %s is fixed once the unit is initialized", full_name(name, r->term, r->name));
  }
  Unit *m = &c->unit;
  for (size_t i = 0; i < n; i++) {
    if (reals(m)[vr[i]] != value[i]) {
      reals(m)[vr[i]] = value[i];
      m->stale = 1;
      if (!is_input(vr[i])) m->restart = 1;
    }
    if (is_input(vr[i])) begin_input(m, (int)vr[i] - FIRST_INPUT, value[i]);
    if (REAL_INFO[vr[i]].kind == IS_PARAMETER) forget_late(&c->late, m, (int)vr[i]);
  }
  return fmi2OK;
}

static fmi2Status set_discrete(Instance *c, const char *call, int target[], const DiscreteInfo info[],
                               const fmi2ValueReference vr[], size_t n, const int value[]) {
  char name[NAME_SIZE];
  for (size_t i = 0; i < n; i++) {
    const DiscreteInfo *r = &info[vr[i]];
    const int max = r->options ? option_count(r->options) : r->max;
    if (r->kind == IS_OUTPUT) FAIL(c, "%s: %s is calculated by the unit and cannot be set", call, r->name);
    if (r->kind == IS_PARAMETER && c->phase == STEPPING)
      FAIL(c, "%s: %s is fixed once the unit is initialized", call, full_name(name, r->term, r->name));
    if (value[i] < r->min || value[i] > max)
      DISCARD(c, "%s: %s = %d is outside %d to %d", call, full_name(name, r->term, r->name), value[i], r->min, max);
  }
  for (size_t i = 0; i < n; i++) {
    if (target[vr[i]] == value[i]) continue;
    target[vr[i]] = value[i];
    c->unit.stale = c->unit.restart = 1;
  }
  return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(1, N_INTEGER, "integer");
  return set_discrete(c, "fmi2SetInteger", integers(&c->unit), INTEGER_INFO, vr, n, value);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  return set_discrete(c, "fmi2SetBoolean", booleans(&c->unit), BOOLEAN_INFO, vr, n, value);
}

#endif
