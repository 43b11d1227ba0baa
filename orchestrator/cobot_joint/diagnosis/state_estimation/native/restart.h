/* Runs along one clock from any of its rows, again and again: units initialised and stepped in one call; restart.py
 * mirrors it. */
#ifndef RESTART_H
#define RESTART_H

#include <stdint.h>

#include "../../../cosim/master/cosim.h"

enum { REAL, INTEGER, BOOLEAN }; /* restart.py: TYPES */

typedef struct {
  fmi2Component component;
  fmi2ResetTYPE *reset;
  fmi2SetupExperimentTYPE *setup_experiment;
  fmi2EnterInitializationModeTYPE *enter_initialization_mode;
  fmi2ExitInitializationModeTYPE *exit_initialization_mode;
  fmi2SetRealTYPE *set_real;
  fmi2SetIntegerTYPE *set_integer;
  fmi2SetBooleanTYPE *set_boolean;
  fmi2GetRealTYPE *get_real;
  fmi2GetIntegerTYPE *get_integer;
  fmi2GetBooleanTYPE *get_boolean;
} RestartUnit;

typedef struct { /* a variable of a unit */
  int32_t unit, type;
  fmi2ValueReference ref;
} Place;

typedef struct { /* what is set before initialization: a value, or the state of that number */
  Place place;
  int32_t state; /* -1: the value */
  double value;
} Setting;

typedef struct { /* while time runs */
  int64_t tick;
  Place place;
  double value;
} Event;

typedef struct { /* an initial value's way from an output, or, unit -1, from the system's input of that number */
  Place from, to;
  double factor, offset;
} Pass;

typedef struct { /* settings, events by time, passes in the order of dependence */
  size_t n_units, n_settings, n_events, n_passes, n_groups;
  const RestartUnit *units;
  const Setting *settings;
  const Event *events;
  const Pass *passes;
  const int32_t *groups, *loops; /* [n_groups]: passes of each group, and whether they are swept until they settle */
  double stop_time;
  int32_t failed; /* the unit that refused, or -1: the master says why */
  char message[256];
} Restart;

typedef struct { /* one run: from the row `first`, tick = first ticks_per_record, over so many rows */
  int64_t first, rows;
  const double *x, *u;   /* states; the system's inputs there */
  const double *samples; /* as in Plan, of the whole clock */
  const int64_t *breaks;
  size_t n_breaks;
  const double *limits; /* as in Plan */
} RestartRun;

/* table: [rows][n_recorded], filled. 0; -1: a unit refuses; -2: out of memory; -3: beyond the limits; else cosim.h says */
COSIM_API int restart_run(Restart *r, Master *m, const RestartRun *run, double *table);

#endif
