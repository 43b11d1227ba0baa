/* One instance of a unit, its phase in the standard's state machine, and how a call is refused. */
#ifndef COBOT_JOINT_INSTANCE_H
#define COBOT_JOINT_INSTANCE_H

#include <stdarg.h>
#include <stdlib.h>

#include "fmi2/integrate.h"
#include "fmi2/start_values.h"
#include "fmi2Functions.h"

/* FMI 2.0.4, 4.2.4 "State Machine for Co-Simulation" */
typedef enum {
  INSTANTIATED = 1,
  INITIALIZATION = 2,
  STEPPING = 4,
  TERMINATED = 8,
  FAILED = 16,       /* a call was an error: no way on but fmi2Reset or fmi2SetFMUstate */
  STOPPED_SHORT = 32 /* fmi2DoStep was discarded: the unit is at the last successful time */
} Phase;
static const char *const PHASE_NAME[] = {[INSTANTIATED] = "instantiated",
                                         [INITIALIZATION] = "in initialization mode",
                                         [STEPPING] = "initialized",
                                         [TERMINATED] = "terminated",
                                         [FAILED] = "failed",
                                         [STOPPED_SHORT] = "short of its step's end"};
enum { READABLE = INITIALIZATION | STEPPING | TERMINATED | FAILED | STOPPED_SHORT, ANY = 63 };

typedef struct {
  const fmi2CallbackFunctions *callbacks;
  char *name;
  bool log_events; /* category logEvents is on */
  Phase phase;
  double stop_time; /* DBL_MAX: not defined */
  Unit start;       /* as instantiated: the table's start values, or those in resources/ */
  LateValues late;  /* from resources/, too */
  Unit unit;
} Instance;

static void say(const Instance *c, fmi2Status status, const char *category, const char *format, ...) {
  char text[512];
  va_list list;
  va_start(list, format);
  vsnprintf(text, sizeof text, format, list);
  va_end(list);
  if (c->callbacks->logger)
    c->callbacks->logger(c->callbacks->componentEnvironment, c->name, status, category, "%s", text);
}

/* an error stays one: the instance is of no use until it is reset or gets a state (FMI 2.0.4, 2.1.3) */
#define FAIL(c, ...) return say((c), fmi2Error, "logStatusError", __VA_ARGS__), (c)->phase = FAILED, fmi2Error
/* nothing has changed, the master may do better */
#define DISCARD(c, ...) return say((c), fmi2Discard, "logStatusDiscard", __VA_ARGS__), fmi2Discard
#define NEEDS(phases)                                                                                                  \
  Instance *c = component;                                                                                             \
  if (!c) return fmi2Error;                                                                                            \
  if (!(c->phase & (phases))) FAIL(c, "%s is not allowed while the unit is %s", __func__, PHASE_NAME[c->phase])
#define NEEDS_POINTER(p)                                                                                               \
  if (!(p)) FAIL(c, "%s: argument " #p " is NULL", __func__)

static inline bool is_input(fmi2ValueReference vr) { return vr - FIRST_INPUT < N_INPUT; } /* unsigned: none below */

/* position of the first reference outside first..count-1, or n */
static size_t first_unknown(const fmi2ValueReference vr[], size_t n, size_t first, size_t count) {
  size_t i = 0;
  while (i < n && vr[i] >= first && vr[i] < count) i++;
  return i;
}

#define CHECK_LIST(first, count, what)                                                                                 \
  if (n > 0) NEEDS_POINTER(vr);                                                                                        \
  if (n > 0) NEEDS_POINTER(value);                                                                                     \
  const size_t bad = first_unknown(vr, n, first, count);                                                               \
  if (bad < n)                                                                                                         \
  FAIL(c, "%s: value reference %u is no " what " variable; they go from %d to %d", __func__, vr[bad], (int)(first),    \
       (int)(count) - 1)

#endif
