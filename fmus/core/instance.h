/* One instance of a unit, its phase in the standards' state machine, and how a call is refused. The same for every version of
 * FMI: an adapter (fmi2/, fmi3/) gives the functions their names and types. */
#ifndef COBOT_JOINT_INSTANCE_H
#define COBOT_JOINT_INSTANCE_H

#include <stdarg.h>
#include <stdlib.h>

#include "core/integrate.h"
#include "core/start_values.h"

/* by the numbers of fmi2Status and fmi3Status */
typedef enum { OK = 0, DISCARDED = 2, REFUSED = 3 } Status;
typedef uint32_t Reference; /* fmi2ValueReference and fmi3ValueReference */

/* FMI 2.0.4, 4.2.4 "State Machine for Co-Simulation"; FMI 3.0, "State Machine for Co-Simulation" */
typedef enum {
  INSTANTIATED = 1,
  INITIALIZATION = 2,
  STEPPING = 4,
  TERMINATED = 8,
  FAILED = 16,        /* a call was an error: no way on but a reset or an FMU state */
  STOPPED_SHORT = 32, /* a step was discarded: the unit is at the last successful time */
  EVENT = 64,         /* the master updates discrete states */
  INTERMEDIATE = 128, /* FMI 3.0: the master looks into a step */
  CONTINUOUS = 256    /* model exchange: the master integrates */
} Phase;
enum {
  ANY = INSTANTIATED | INITIALIZATION | STEPPING | TERMINATED | FAILED | STOPPED_SHORT | EVENT | CONTINUOUS,
  READABLE = (ANY & ~INSTANTIATED) | INTERMEDIATE
};

static const char *phase_name(Phase phase) {
  switch (phase) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "in initialization mode";
    case STEPPING: return "initialized";
    case TERMINATED: return "terminated";
    case FAILED: return "failed";
    case STOPPED_SHORT: return "short of its step's end";
    case EVENT: return "in event mode";
    case INTERMEDIATE: return "within a step";
    case CONTINUOUS: return "in continuous-time mode";
  }
  return NULL; /* no phase */
}

typedef struct Instance Instance;
struct Instance {
  void (*log)(const Instance *c, Status status, const char *category, const char *text);
  const char *call; /* the function of the standard that is running, for messages */
  char *name;
  bool log_events; /* category logEvents is on */
  Phase phase;
  double stop_time; /* DBL_MAX: not defined */
  Unit start;       /* as instantiated: the table's start values, or those in resources/ */
  LateValues late;  /* from resources/, too */
  Unit unit;
};

/* volatile: what has a size that it knows GCC copies by `rep movsq`, and the C library in half the time */
static const volatile size_t UNIT_BYTES = sizeof(Unit);
static inline void copy_unit(Unit *to, const Unit *from) { memcpy(to, from, UNIT_BYTES); }

static void say(const Instance *c, Status status, const char *category, const char *format, ...) {
  char text[512];
  va_list list;
  va_start(list, format);
  const int used = status == OK ? 0 : snprintf(text, sizeof text, "%s: ", c->call);
  vsnprintf(text + used, sizeof text - (size_t)used, format, list);
  va_end(list);
  c->log(c, status, category, text);
}

/* an error stays one: the instance is of no use until it is reset or gets a state (FMI 2.0.4, 2.1.3) */
#define FAIL(c, ...) return say((c), REFUSED, "logStatusError", __VA_ARGS__), (c)->phase = FAILED, REFUSED
/* nothing has changed, the master may do better */
#define DISCARD(c, ...) return say((c), DISCARDED, "logStatusDiscard", __VA_ARGS__), DISCARDED
#define NEEDS_POINTER(p)                                                                                               \
  if (!(p)) FAIL(c, "argument " #p " is NULL")

/* every function of a standard begins so */
static Status enter(Instance *c, const char *call, int phases) {
  if (!c) return REFUSED;
  c->call = call;
  if (!(c->phase & phases)) FAIL(c, "not allowed while the unit is %s", phase_name(c->phase));
  return OK;
}

static inline bool is_input(Reference vr) { return vr - FIRST_INPUT < N_INPUT; } /* unsigned: none below */

/* position of the first reference outside first..count-1, or n */
static size_t first_unknown(const Reference vr[], size_t n, size_t first, size_t count) {
  size_t i = 0;
  while (i < n && vr[i] >= first && vr[i] < count) i++;
  return i;
}

#define CHECK_LIST(first, count, what)                                                                                 \
  if (n > 0) NEEDS_POINTER(vr);                                                                                        \
  if (n > 0) NEEDS_POINTER(value);                                                                                     \
  const size_t bad = first_unknown(vr, n, first, count);                                                               \
  if (bad < n)                                                                                                         \
  FAIL(c, "value reference %u is no " what " variable; they go from %d to %d", vr[bad], (int)(first), (int)(count) - 1)

#endif
