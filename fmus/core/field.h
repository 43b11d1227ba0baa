/* A unit as a vector field: what model exchange offers in seven calls, in one, for a master of our own that integrates several
 * units as one system (orchestrator/cobot_joint/cosim/monolithic). Beside FMI: no other master has to know.
 * The instance is one for co-simulation, initialized. Its values lie in the order of their value references; the master writes
 * states and inputs there, and reads what follows from them. */
#ifndef COBOT_JOINT_FIELD_H
#define COBOT_JOINT_FIELD_H

#include <stdint.h>

enum { FIELD_VERSION = 1 };

typedef struct {
  int32_t version, n_states, first_derivative, n_events; /* states are values[0] to values[n_states - 1] */
  double *(*values)(void *instance);                     /* NULL: it is not initialized */
  double (*nominal)(int32_t state);                      /* what counts as much of a state */
  void (*evaluate)(void *instance, double t);            /* derivatives and outputs that other units need */
  void (*observe)(void *instance, double t);             /* all outputs, at the end of a communication step */
  void (*indicators)(void *instance, double z[]);        /* at the point last evaluated; positive: the event is due */
  int32_t (*happen)(void *instance, double t);           /* all that is due; -1: without end */
  double (*next_event)(void *instance);                  /* s, of events that come by time; INFINITY: none */
} VectorField;

#endif
