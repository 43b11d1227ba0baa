/* Co-simulation master over FMI 2.0 function pointers: the data that Python fills in (native.py mirrors it) and the calls it makes.
 *
 * A signal is a number that changes in time: first the outputs of all units, unit by unit, then the system's own inputs.
 * During a communication step [t, t+h] every real signal is a polynomial of the time since t, at most cubic.
 */
#ifndef COSIM_H
#define COSIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "core/field.h"
#include "fmi2FunctionTypes.h"

#if defined _WIN32
#define COSIM_API __declspec(dllexport)
#else
#define COSIM_API __attribute__((visibility("default")))
#endif

typedef struct { /* value = factor*signal + offset */
  int32_t signal;
  double factor, offset;
} Wire;

typedef struct { /* variables of one type of one unit */
  size_t n;
  const fmi2ValueReference *refs;
} Variables;

typedef struct {
  const char *name;
  fmi2Component component;
  fmi2SetRealTYPE *set_real;
  fmi2SetIntegerTYPE *set_integer;
  fmi2SetBooleanTYPE *set_boolean;
  fmi2GetRealTYPE *get_real;
  fmi2GetIntegerTYPE *get_integer;
  fmi2GetBooleanTYPE *get_boolean;
  fmi2SetRealInputDerivativesTYPE *set_real_input_derivatives;
  fmi2GetRealOutputDerivativesTYPE *get_real_output_derivatives;
  fmi2DoStepTYPE *do_step;
  fmi2GetFMUstateTYPE *get_state;
  fmi2SetFMUstateTYPE *set_state;
  fmi2FreeFMUstateTYPE *free_state;
  Variables real_inputs, integer_inputs, boolean_inputs;
  const Wire *wires;                                        /* of the inputs, in that order */
  Variables real_outputs, integer_outputs, boolean_outputs; /* that drive inputs: fetched in every step */
  Variables real_watched, integer_watched, boolean_watched; /* that are only recorded: fetched where recorded */
  int32_t first_signal;                                     /* outputs are numbered in that order */
  int32_t input_order; /* 3: follows cubics, 1: follows lines, 0: sees constants over a step */
  int32_t holds_end;   /* where input_order is 0: the constant is the value at the step's end, else at its middle */
  int32_t stairs; /* where input_order is 0: of how many equal parts, and a short last one, a step is made; 0: of one */
  int32_t output_derivatives;
  const VectorField *field; /* of a unit of ours, where the scheme is monolithic */
  int32_t is_sink; /* no other unit reads it: stepped once, when a step is final, from row to row; never taken back */
} Unit;

typedef struct { /* work through two flanges that are wired together, J; power: what counts as much, W */
  int32_t given, taken;
  double power;
} Flow;

typedef struct
{ /* effort times flow, of which one is the unit's input (by its place among the Reals), the other an output */
  int32_t unit, input, output;
} Port;

typedef struct { /* schemes.py says what the fields mean */
  int32_t sequential, extrapolation, interpolation, sweeps, adaptive;
  double tolerance, pace;
} Scheme;

#define AT_TICK 1e-6 /* of a step, by which a sample may miss the tick that it is at */

typedef struct {
  size_t n_units;
  const Unit *units;
  size_t n_outputs, n_inputs; /* signals of the units, signals of the system's inputs */
  const double *nominal;      /* of every unit signal: scales the coupling error */
  const int32_t *judged;      /* of every unit signal: 1 where straying from what was expected is a coupling error */
  size_t n_flows;
  const Flow *flows; /* energy that one unit gives and another takes: a difference is a coupling error, too */
  size_t n_ports;
  const Port *ports; /* work through them is measured, since their units do not tell it */
  size_t n_samples;
  const double *sample_time; /* [n_samples], rising; inputs are linear between samples and held outside */
  const double *samples;     /* [n_inputs][n_samples] */
  const int32_t *held;       /* [n_inputs]: 1 of one that jumps at its samples, and stays from one to the next */
  size_t n_recorded;
  const Wire *recorded;
  const double *limits; /* [n_recorded]: a run that is found beyond them, in absolute value, is given up; NULL: none */
  double start_time, step;
  int64_t ticks_per_record; /* a row is recorded at every multiple */
  int64_t max_stride;       /* longest step in ticks: a power of two; 1 unless the scheme is adaptive */
  size_t n_breaks;
  const int64_t *breaks; /* [n_breaks], rising: ticks that no longer step may pass over, since inputs turn there */
  size_t n_ordered;      /* monolithic: how many units are one system; 0: the units step themselves */
  const int32_t *order;  /* [n_ordered]: in which each finds its inputs known */
  Scheme scheme;
} Plan;

typedef struct {
  int64_t steps, rejected, sweeps, warnings;
} Counters;

typedef struct Master Master;
/* Another scheme may do better; no step is short enough. Calls else return 0, or -1; with a message. */
enum { COSIM_UNFIT = 1, COSIM_STUCK = 2 };

/* The plan's arrays stay the caller's and have to outlive the master. NULL: out of memory. */
COSIM_API Master *cosim_create(const Plan *plan);
COSIM_API void cosim_destroy(Master *m);

/* At a tick, from the units' present state. */
COSIM_API int cosim_begin(Master *m, int64_t tick);
/* After values were set in units from outside: signals that jumped take their past with them. */
COSIM_API int cosim_resume(Master *m);
/* Advances to `tick`; writes a row of n_recorded for every recorded tick after the present one. */
COSIM_API int cosim_advance(Master *m, int64_t tick, double *rows);
/* Writes the row of the present tick. */
COSIM_API int cosim_record(Master *m, double *row);
/* How many rows have been written since the beginning: what is there when a unit fails. */
COSIM_API int64_t cosim_rows(const Master *m);

typedef struct
{ /* a unit as a function of known variables; reals, integers and booleans have the same values at all points */
  fmi2Component component;
  fmi2ResetTYPE *reset;
  fmi2SetupExperimentTYPE *setup_experiment;
  fmi2EnterInitializationModeTYPE *enter_initialization_mode;
  fmi2SetRealTYPE *set_real;
  fmi2SetIntegerTYPE *set_integer;
  fmi2SetBooleanTYPE *set_boolean;
  fmi2GetRealTYPE *get_real;
  fmi2GetDirectionalDerivativeTYPE *get_directional_derivative;
  Variables reals, integers, booleans;
  const double *real_values;
  const int32_t *integer_values, *boolean_values;
  Variables known, unknown, directions; /* directions: known variables and parameters */
  char message[256];
} PointFunction;
/* time: [n_points]; known: [n_points][known.n]; unknown: [n_points][unknown.n], filled;
 * jacobian: [n_points][directions.n][unknown.n], filled, or NULL */
COSIM_API int cosim_points(PointFunction *f, size_t n_points, const double *time, const double *known, double *unknown,
                           double *jacobian);
/* At one point the derivatives by one direction, or by one in each column, a column for each set of values of some Reals.
 * varied: which, values: [n_columns][varied->n]; jacobian: [n_columns][unknown.n], filled */
COSIM_API int cosim_varied(PointFunction *f, double t, const double *known, const Variables *varied, size_t n_columns,
                           const double *values, double *jacobian);

/* A unit's logger: its componentEnvironment is a Log, which keeps the last warning or error. */
typedef struct {
  char last[1024];
} Log;
COSIM_API void cosim_log(fmi2ComponentEnvironment log, fmi2String instance, fmi2Status status, fmi2String category,
                         fmi2String message, ...);

/* Work through every port since tick 0, and the integral of its power's absolute value, in the variables' units. */
COSIM_API void cosim_works(const Master *m, double *work, double *work_abs);
/* How far it has got; after an error, to where the last step ended. */
COSIM_API int64_t cosim_tick(const Master *m);
COSIM_API const char *cosim_message(const Master *m);
COSIM_API void cosim_counters(const Master *m, Counters *counters);

#endif
