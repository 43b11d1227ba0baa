/* This unit's vector field: field.h says what for. */
#ifndef COBOT_JOINT_VECTOR_FIELD_H
#define COBOT_JOINT_VECTOR_FIELD_H

#include "core/field.h"
#include "core/steps.h"

static double *field_values(void *instance) {
  Instance *c = instance;
  if (c->phase != STEPPING) return NULL;
  for (int j = 0; j < N_INPUT; j++) c->unit.u[j].order = c->unit.u[j].answers = 0; /* the master says what they are */
  refresh(&c->unit);
  return reals(&c->unit);
}

static double field_nominal(int32_t state) { return REAL_INFO[state].nominal; }

static void field_evaluate(void *instance, double t) {
  Unit *m = &((Instance *)instance)->unit;
  m->time = t;
  equations(m);
}

static void field_observe(void *instance, double t) {
  Unit *m = &((Instance *)instance)->unit;
  m->time = t;
  equations(m);
  end_of_step(m, false);
  m->stale = 0;
}

static void field_indicators(void *instance, double z[]) {
  (void)instance, (void)z;
#if defined UNIT_EVENTS
  unit_indicators(&((Instance *)instance)->unit, z);
#endif
}

static int32_t field_happen(void *instance, double t) {
  Instance *c = instance;
  Unit *m = &c->unit;
  bool happened;
  m->time = t;
  m->stale = 1;
  if (apply_late(&c->late, m)) m->restart = 1;
  const Status status = update_discrete_states(c, &happened);
  return status == OK ? 0 : -1;
}

static double field_next_event(void *instance) {
  const Instance *c = instance;
  double next = next_late(&c->late, &c->unit);
#if defined UNIT_TIMED
  next = fmin(next, unit_next_time(&c->unit));
#endif
  return next;
}

static const VectorField VECTOR_FIELD = {FIELD_VERSION,    N_STATE,       FIRST_DER,       N_EVENT,
                                         field_values,     field_nominal, field_evaluate,  field_observe,
                                         field_indicators, field_happen,  field_next_event};

#endif
