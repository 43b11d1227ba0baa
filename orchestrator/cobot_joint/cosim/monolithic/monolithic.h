/* The scheme "monolithic": all units as one system, integrated in steps that its error allows, from event to event. */
#ifndef COSIM_MONOLITHIC_H
#define COSIM_MONOLITHIC_H

#include "master/master.h"

typedef struct Monolithic Monolithic;

/* All but the first return 0, or -1 with a message of the master's. NULL: out of memory, or the system is too large. */
Monolithic *monolithic_create(const Plan *plan);
void monolithic_destroy(Monolithic *o);
int monolithic_begin(Monolithic *o, Master *m);
/* after values were set in units from outside */
int monolithic_resume(Monolithic *o, Master *m);
int monolithic_advance(Monolithic *o, Master *m, int64_t tick, double *rows);

#endif
