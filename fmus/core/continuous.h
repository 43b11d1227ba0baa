/* Model exchange: the master integrates, the unit gives derivatives and event indicators (FMI 2.0.4, chapter 3). */
#ifndef COBOT_JOINT_CONTINUOUS_H
#define COBOT_JOINT_CONTINUOUS_H

#include "core/steps.h"

/* NULL, or why a master cannot integrate this unit */
static const char *no_model_exchange(void) {
  const char *why = NULL;
#define SAMPLES_STEPS(what) why = what;
#include "core/rows.h"
  return why;
}

#define CHECK_COUNT(given, count, what)                                                                                \
  if ((given) != (count)) FAIL(c, "%u " what " asked for, there are %d", (unsigned)(given), (int)(count))

static Status set_time(Instance *c, double t) {
  if (!(t >= c->unit.start_time) || !isfinite(t)) FAIL(c, "time %g; the simulation began at %g", t, c->unit.start_time);
  c->unit.time = t;
  c->unit.stale = 1;
  return OK;
}

static Status set_continuous_states(Instance *c, const double x[], size_t n) {
  CHECK_COUNT(n, N_X, "continuous states");
  if (n > 0) NEEDS_POINTER(x);
  for (size_t i = 0; i < n; i++)
    if (!isfinite(x[i])) DISCARD(c, "%s = %g is not finite", REAL_INFO[i].name, x[i]);
  if (n > 0) memcpy(reals(&c->unit), x, n * sizeof *x);
  c->unit.stale = 1;
  return OK;
}

static Status get_continuous_states(Instance *c, double x[], size_t n) {
  CHECK_COUNT(n, N_X, "continuous states");
  if (n > 0) NEEDS_POINTER(x);
  if (n > 0) memcpy(x, reals(&c->unit), n * sizeof *x);
  return OK;
}

static Status get_derivatives(Instance *c, double der[], size_t n) {
  CHECK_COUNT(n, N_X, "derivatives");
  if (n > 0) NEEDS_POINTER(der);
  refresh(&c->unit);
  for (size_t i = 0; i < n; i++) {
    der[i] = reals(&c->unit)[FIRST_DER + i];
    if (!isfinite(der[i])) DISCARD(c, "the derivative of %s is not finite", REAL_INFO[i].name);
  }
  return OK;
}

static Status get_nominals(Instance *c, double nominal[], size_t n) {
  CHECK_COUNT(n, N_X, "nominal values");
  if (n > 0) NEEDS_POINTER(nominal);
  for (size_t i = 0; i < n; i++) nominal[i] = REAL_INFO[i].nominal;
  return OK;
}

static Status get_event_indicators(Instance *c, double z[], size_t n) {
  CHECK_COUNT(n, N_EVENT, "event indicators");
  if (n > 0) NEEDS_POINTER(z);
  refresh(&c->unit);
#if defined UNIT_EVENTS
  if (n > 0) unit_indicators(&c->unit, z);
  for (size_t k = 0; k < n; k++)
    if (z[k] == 0) z[k] = -DBL_MIN; /* a search for roots that begins at one would not see it */
#endif
  return OK;
}

/* when the unit wants the next time event: a late value, a sample, one of its own */
static double next_time_event(const Instance *c) {
  double next = next_late(&c->late, &c->unit);
#if defined UNIT_SAMPLED
  const Unit *m = &c->unit;
  const double samples = m->clocked ? INFINITY : floor((m->time - m->start_time) / SAMPLE_PERIOD + 1e-6) + 1;
  next = fmin(next, m->start_time + samples * SAMPLE_PERIOD);
#endif
#if defined UNIT_TIMED
  next = fmin(next, unit_next_time(&c->unit));
#endif
  return next;
}

/* Event mode of model exchange: samples and values whose time has come, then what is due. *moved: states have jumped. */
static Status new_discrete_states(Instance *c, bool *moved) {
  Unit *m = &c->unit;
  bool happened;
  double before[N_X1];
  memcpy(before, reals(m), sizeof(double) * N_X);
  if (apply_late(&c->late, m)) m->restart = 1;
#if defined UNIT_SAMPLED
  const double samples = (m->time - m->start_time) / SAMPLE_PERIOD;
  refresh(m);
  if (!m->clocked && fabs(samples - nearbyint(samples)) < 1e-6) unit_sample(m);
#endif
  const Status status = update_discrete_states(c, &happened);
  *moved = memcmp(before, reals(m), sizeof(double) * N_X) != 0;
  return status;
}

#endif
