/* An isolated unit as Python starts it: the fmi2* functions of proxy.c stand in for those of its library. */
#ifndef COSIM_ISOLATION_H
#define COSIM_ISOLATION_H

#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"

#if defined _WIN32
#define COSIM_API __declspec(dllexport)
#else
#define COSIM_API __attribute__((visibility("default")))
#endif

enum { RUNS, NO_PROCESS, NOT_OPENED, REFUSED, ENDED }; /* how an instantiation went */

typedef struct {
  const char *host, *library; /* paths */
  double time_limit;          /* s, of one call */
  uint64_t memory_limit;      /* bytes; 0: none */
  size_t n_inputs;            /* what is told of a unit that ended: its Real, Integer and Boolean inputs */
  const char *const *input_names;
  const uint32_t *input_refs;
  const char *input_types; /* of each: R, I or B */
  int32_t pending;         /* a file: where it can be read, nobody waits for the unit any more; -1: none */
  int32_t outcome;         /* filled */
} Isolation;

/* What the next fmi2Instantiate of this thread starts; filled by it. */
COSIM_API void cosim_isolate(Isolation *next);
/* How the unit's process ended; NULL: it runs. Without a component: of the one that this thread freed last. */
COSIM_API const char *cosim_ended(fmi2Component component);

#endif
