/* Clocks: the part of fmi3.c that ticks, in event mode. A unit's own clock is active while an event of its is due, until
 * fmi3UpdateDiscreteStates lets that happen; the master's clock tells when the unit takes its samples. */
#ifndef COBOT_JOINT_CLOCKS_H
#define COBOT_JOINT_CLOCKS_H

static bool is_clock(Reference vr) { return vr >= FMI3_CLOCK && vr < FMI3_CLOCK + N_CLOCK; }

static bool is_sample_clock(Reference vr) {
  switch (vr - FMI3_CLOCK) {
#define SAMPLE_CLOCK(name, ...)                                                                                        \
  case CLOCK_##name: return true;
#include "core/rows.h"
    default: return false;
  }
}

static bool is_active(const Unit *m, Reference vr) {
  double z[N_EVENT1] = {0};
#if defined UNIT_EVENTS
  unit_indicators(m, z);
#endif
  (void)m, (void)z;
  switch (vr - FMI3_CLOCK) {
#define CLOCK(name, ticks, ...)                                                                                        \
  case CLOCK_##name: return ticks;
#define SAMPLE_CLOCK(name, ...)                                                                                        \
  case CLOCK_##name: return m->ticks;
#include "core/rows.h"
    default: return false;
  }
}

static Status get_clocks(Instance *c, const Reference vr[], size_t n, fmi3Clock value[]) {
  if (n > 0) NEEDS_POINTER(vr);
  if (n > 0) NEEDS_POINTER(value);
  refresh(&c->unit);
  for (size_t i = 0; i < n; i++) {
    if (!is_clock(vr[i])) FAIL(c, "value reference %u is no clock", vr[i]);
    value[i] = is_active(&c->unit, vr[i]);
  }
  return OK;
}
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock value[]) {
  CALL(EVENT, get_clocks(instance, vr, n, value));
}

static Status set_clocks(Instance *c, const Reference vr[], size_t n, const fmi3Clock value[]) {
  if (n > 0) NEEDS_POINTER(vr);
  if (n > 0) NEEDS_POINTER(value);
  for (size_t i = 0; i < n; i++) {
    if (!is_sample_clock(vr[i])) FAIL(c, "value reference %u is no clock that a master sets", vr[i]);
    if (c->unit.ticks && !value[i]) FAIL(c, "a tick cannot be taken back");
  }
  for (size_t i = 0; i < n; i++)
    if (value[i]) c->unit.ticks = c->unit.clocked = 1;
  return OK;
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[]) {
  CALL(EVENT, set_clocks(instance, vr, n, value));
}

#endif
