/* Get and set: every reference and value is checked before anything changes. */
#ifndef COBOT_JOINT_VARIABLES_H
#define COBOT_JOINT_VARIABLES_H

#include "core/life.h"

/* values as states, inputs and parameters have them now */
static inline Status bring_up_to_date(Instance *c) {
  if ((c->phase & (INITIALIZATION | STEPPING | EVENT | INTERMEDIATE | CONTINUOUS)) && !settle(c))
    FAIL(c, "events follow each other without end");
  return OK;
}

static inline Status get_reals(Instance *c, const Reference vr[], size_t n, double value[]) {
  CHECK_LIST(0, N_REAL, "real");
  const Status status = bring_up_to_date(c);
  if (status != OK) return status;
  for (size_t i = 0; i < n; i++) value[i] = reals(&c->unit)[vr[i]];
  return OK;
}

static inline Status set_reals(Instance *c, const Reference vr[], size_t n, const double value[]) {
  CHECK_LIST(0, N_PUBLIC, "real");
  char name[NAME_SIZE];
  for (size_t i = 0; i < n; i++) { /* all or nothing */
    if (is_input(vr[i]) && isfinite(value[i]) && !BOUNDS_INFO[vr[i]].given) continue;
    const RealInfo *r = &REAL_INFO[vr[i]];
    if (r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL || r->kind == IS_LOCAL)
      FAIL(c, "%s is calculated by the unit and cannot be set", r->name);
    if (r->kind == IS_STATE && is_initialized(c))
      FAIL(c, "%s is a state; its start value can only be set before the initialization ends", r->name);
    if (!isfinite(value[i])) DISCARD(c, "%s = %g is not finite", full_name(name, r->term, r->name), value[i]);
    if (value[i] < lowest(vr[i]) || value[i] > highest(vr[i]))
      DISCARD(c, "%s = %g %s is outside %g to %g", full_name(name, r->term, r->name), value[i], r->unit, lowest(vr[i]),
              highest(vr[i]));
    if (c->phase == CONTINUOUS && r->kind == IS_PARAMETER)
      FAIL(c, "%s is a parameter; in model exchange it is set in event mode", full_name(name, r->term, r->name));
    if (FIXED_INFO[vr[i]] && is_initialized(c))
      FAIL(c, "%s is fixed once the unit is initialized", full_name(name, r->term, r->name));
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
  return OK;
}

/* may an Integer or a Boolean take this value now? */
static inline Status check_discrete(Instance *c, const DiscreteInfo *r, int value) {
  char name[NAME_SIZE];
  const int max = r->options ? option_count(r->options) : r->max;
  if (r->kind == IS_OUTPUT) FAIL(c, "%s is calculated by the unit and cannot be set", r->name);
  if (r->kind == IS_PARAMETER && is_initialized(c))
    FAIL(c, "%s is fixed once the unit is initialized", full_name(name, r->term, r->name));
  if (value < r->min || value > max)
    DISCARD(c, "%s = %d is outside %d to %d", full_name(name, r->term, r->name), value, r->min, max);
  return OK;
}

static inline void put_discrete(Unit *m, int *variable, int value) {
  if (*variable == value) return;
  *variable = value;
  m->stale = m->restart = 1;
}

#endif
