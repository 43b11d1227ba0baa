/* A unit as its table (MODEL_DEF) says: the struct that holds everything it knows, and the references into it.
 *
 * Every variable is a named member, and the same memory is an array: value reference = index. Order of the reals:
 * states, integrals, inputs, outputs, locals, parameters, and behind the public ones the derivatives.
 * The struct is plain data, so that an FMU state is a copy of it. */
#ifndef COBOT_JOINT_UNIT_H
#define COBOT_JOINT_UNIT_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { INPUT_ORDER = 3 }; /* highest derivative of an input that a step can follow */

/* ---- how many of each -------------------------------------------------------------------------------------- */
#define COUNT_ROW(...) +1
enum {
  N_STATE = 0
#define STATE COUNT_ROW
#include "core/rows.h"
};
enum {
  N_INTEGRAL = 0
#define INTEGRAL COUNT_ROW
#include "core/rows.h"
};
enum {
  N_INPUT = 0
#define INPUT COUNT_ROW
#include "core/rows.h"
};
enum {
  N_OUTPUT = 0
#define OUTPUT COUNT_ROW
#include "core/rows.h"
};
enum {
  N_EVENT = 0
#define EVENT COUNT_ROW
#include "core/rows.h"
};
enum HeldNumber {
#define HELD_TORQUE(tau, ...) HELD_##tau,
#include "core/rows.h"
  N_HELD
};
enum { N_X = N_STATE + N_INTEGRAL, FIRST_INPUT = N_X };

/* ---- value references ---------------------------------------------------------------------------------------- */
enum RealReference {
#define STATE(name, ...) VR_##name,
#include "core/rows.h"
#define INTEGRAL(name, ...) VR_##name,
#include "core/rows.h"
#define INPUT(name, ...) VR_##name,
#include "core/rows.h"
#define OUTPUT(name, ...) VR_##name,
#include "core/rows.h"
#define LOCAL(name, ...) VR_##name,
#include "core/rows.h"
#define PARAMETER(term, name, ...) VR_##term##_##name,
#define SHAPE(term, name, ...) VR_##term##_##name,
#include "core/rows.h"
  N_PUBLIC,
  FIRST_DER = N_PUBLIC,
  N_REAL = N_PUBLIC + N_X
};
/* 0 stays free: a unit may have none */
enum IntegerReference {
  VR_NO_INTEGER,
#define CHOICE(term, name, ...) VR_##term##_##name,
#define COUNT(term, name, ...) VR_##term##_##name,
#define CODE(name, ...) VR_##name,
#include "core/rows.h"
  N_INTEGER
};
enum BooleanReference {
  VR_NO_BOOLEAN,
#define SWITCH(name, ...) VR_##name,
#define SIGNAL(name, ...) VR_##name,
#include "core/rows.h"
  N_BOOLEAN
};
enum EventNumber {
  NO_EVENT = -1,
#define EVENT(name, ...) EVENT_##name,
#include "core/rows.h"
};

/* a torque that the master holds: the shaft at the step's begin, and by what it answers within the step (held.h) */
typedef struct {
  double h, t0, phi, w, tau, C, D; /* h: length of the step, 0: nothing known */
} Anchor;

typedef struct {
  int count;
  double last; /* s */
} Happened;

/* ---- the unit -------------------------------------------------------------------------------------------------- */
/* Variables of a type lie one behind the other, in the order of their value references: reals(), integers(), booleans().
 * A union of names and arrays would say so, but has no place in C99, where all its members need names. */
typedef struct Unit {
#define STATE(name, ...) double name;
#include "core/rows.h"
#define INTEGRAL(name, ...) double name;
#include "core/rows.h"
#define INPUT(name, ...) double name;
#include "core/rows.h"
#define OUTPUT(name, ...) double name;
#include "core/rows.h"
#define LOCAL(name, ...) double name;
#include "core/rows.h"
#define PARAMETER(term, name, ...) double term##_##name;
#define SHAPE(term, name, ...) double term##_##name;
#include "core/rows.h"
#define STATE(name, ...) double der_##name;
#include "core/rows.h"
#define INTEGRAL(name, ...) double der_##name;
#include "core/rows.h"
  int no_integer;
#define CHOICE(term, name, ...) int term##_##name;
#define COUNT(term, name, ...) int term##_##name;
#define CODE(name, ...) int name;
#include "core/rows.h"
  int no_boolean;
#define SWITCH(name, ...) int name;
#define SIGNAL(name, ...) int name;
#include "core/rows.h"
  double time, start_time; /* s */
  /* inputs over a step: value and derivatives at t0, per input */
  struct {
    double t0, c[INPUT_ORDER + 1];
    int order, fresh, streamed; /* fresh: set since the last step; streamed: and before that one, too */
    int given, answers;         /* given: with derivatives; answers: by its shaft, held.h */
  } u[N_INPUT + 1];
  Anchor anchor[N_HELD + 1];
  double step;                    /* s, what the integrator takes next */
  double tolerance;               /* local error per step, relative to each state's nominal value */
  int stale;                      /* derivatives and outputs no longer belong to states, inputs and parameters */
  int restart;                    /* parameters changed: unit_start has to run again */
  Happened happened[N_EVENT + 1]; /* since the step began */
  int clocked, ticks;             /* a clock of the master's tells when to sample; it ticks now */
  uint32_t changed; /* bit k: the k-th late value of resources/ has come, or the user set that parameter */
#define MEMORY(type, name, count) type name[count];
#include "core/rows.h"
} Unit;

static inline double *reals(const Unit *m) { return (double *)m; }
static inline int *integers(const Unit *m) { return (int *)((char *)m + offsetof(Unit, no_integer)); }
static inline int *booleans(const Unit *m) { return (int *)((char *)m + offsetof(Unit, no_boolean)); }

/* neither type has gaps */
typedef char reals_are_dense[offsetof(Unit, no_integer) == N_REAL * sizeof(double) ? 1 : -1];
typedef char
    integers_are_dense[offsetof(Unit, no_boolean) - offsetof(Unit, no_integer) == N_INTEGER * sizeof(int) ? 1 : -1];

/* ---- what equations.c gives ------------------------------------------------------------------------------------ */
/* after the parameters changed: whatever follows from them alone */
static void unit_start(Unit *m);
/* derivatives and outputs from time, states, inputs and parameters; changes nothing else */
static void unit_equations(Unit *m);
/* with EVENT rows: z[k] turns positive where event k happens; then what the event changes.
 * With #define UNIT_SAMPLED in equations.c: unit_sample(m), once at the end of each communication step, or where a clock of
 * FMI 3.0 ticks.
 * With #define UNIT_TIMED: unit_next_time(m), when the next time event is due (INFINITY: never), and unit_time_event(m), what
 * it changes: no state.
 * With #define UNIT_OBSERVED: unit_observe(m), outputs that follow from the states and that nothing else needs. */

/* s; a drive reads its encoder this often where no communication points tell it when: the step of DefaultExperiment */
static const double SAMPLE_PERIOD = 1e-3;

#define PI 3.14159265358979323846
/* tanh to 2e-16, by exp: it is in every evaluation, and libm's own, exact to the last bit of tiny ones, takes twice as long */
static inline double tanh_by_exp(double x) {
  const double most = 20, size = fabs(x); /* beyond, it is 1 */
  return copysign(size >= most ? 1 : 1 - 2 / (exp(2 * size) + 1), x);
}
/* smoothed sign, docs/bench.md */
static inline double sgn(double w, double e) { return tanh_by_exp(w / e); }
static inline double square(double x) { return x * x; }
static inline double positive(double x) { return x > 0 ? x : 0; } /* fmax would be a call, for the sake of NaN */
static inline double clamp(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

#endif
