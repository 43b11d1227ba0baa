/* Units as one system of ordinary differential equations dx/dt = f(t, x): their vector fields, and the wires between them. */
#ifndef COSIM_FIELD_SYSTEM_H
#define COSIM_FIELD_SYSTEM_H

#include "core/field.h"
#include "master/cosim.h"
#include "monolithic/linear.h"

enum { MOST_COLUMNS = 64, MOST_EVENTS = 32, MOST_UNITS = 64 };

typedef struct { /* *to = factor*(*from) + offset */
  double *to;
  const double *from;
  double factor, offset;
} Feed;

typedef struct { /* an output, and where its unit has it */
  double *to;
  const double *from;
} Copy;

typedef struct { /* a unit among them */
  const Unit *unit;
  const VectorField *field;
  void *instance;
  double *values;  /* its variables, by value reference */
  size_t first, n; /* its states in x */
  Feed *feeds;     /* of its inputs */
  size_t n_given;
  Copy *given;                    /* of its outputs that are no states */
  bool taken;                     /* at ticks: its outputs, or what follows from them, are recorded or go to a sink */
  bool depends[MOST_COLUMNS + 1]; /* by column: whether a state, an input, the time was seen to matter */
} FieldUnit;

typedef struct {
  int32_t unit;
  bool last; /* all its inputs are known; before, only outputs that need none of them are */
} Visit;

typedef struct {
  const Plan *plan;
  size_t n_units, n; /* without sinks; states in all */
  FieldUnit units[MOST_UNITS];
  size_t n_visits;
  Visit visits[2 * MOST_UNITS]; /* in an order in which each unit finds its inputs known */
  double *state[MOST_STATES];   /* where the units have them, and what these are by time */
  const double *derivative[MOST_STATES];
  size_t n_known;
  Copy *known;                     /* [n_outputs]: of outputs that are states */
  double *signal;                  /* [n_outputs + n_inputs] */
  double *slope;                   /* [n_outputs + n_inputs]: by time alone, of inputs between their samples */
  double (*gradient)[MOST_STATES]; /* [n_outputs + n_inputs]: of signals, by state */
  uint64_t *reaches;               /* [n_outputs + n_inputs]: states that a signal depends on */
  size_t sample;                   /* sample_time[sample] <= t < sample_time[sample + 1] */
  size_t held;                     /* the same at `since`, of inputs that hold their samples */
  double since;                    /* s, when the step under way began: held inputs stay as they were then */
  double nominal[MOST_STATES];
  uint64_t rows[MOST_STATES]; /* where J may differ from zero */
  bool rows_grew;             /* since somebody looked */
  int64_t asked;              /* how often J was asked for */
} FieldSystem;

/* Of the units in the plan's `order`. NULL: out of memory, or it is too large. */
FieldSystem *system_create(const Plan *plan);
void system_destroy(FieldSystem *s);

/* Takes the states from the units as they are now. Returns a unit that is not initialized, or NULL. */
const Unit *system_begin(FieldSystem *s, double x[]);
/* Whether a unit's equations give its output j, rather than a look at the end of a communication step. */
bool system_gives(const FieldUnit *u, size_t j, double t);
/* A unit of which another reads what its equations do not give, such as a reading once per communication step; or NULL. */
const Unit *system_unfit(FieldSystem *s, double t);
/* dx/dt; units keep the point, signals are those of it */
void system_evaluate(FieldSystem *s, double t, const double x[], double f[]);
/* The same of `taken` units alone, for the signals that they give; derivatives are nobody's afterwards */
void system_look(FieldSystem *s, double t, const double x[]);
/* A unit is taken, and so are those from whose outputs its inputs follow at once. */
void system_take_unit(FieldSystem *s, FieldUnit *u);
/* The unit that has to be evaluated for a signal is taken; none where it is a state, or comes from outside. */
void system_take(FieldSystem *s, size_t signal);
/* J = df/dx and df/dt at t, x, the point last evaluated, where f was found, by differences of one unit at a time; units are
 * somewhere else afterwards */
void system_jacobian(FieldSystem *s, double t, const double x[], const double f[], double J[][MOST_STATES],
                     double f_t[]);
/* Positive where an event is due: the largest indicator at the point last evaluated; -INFINITY without events */
double system_indicator(FieldSystem *s);
/* What is due happens; x is what it leaves. -1: events follow each other without end */
int system_happen(FieldSystem *s, double t, double x[]);
double system_next_event(const FieldSystem *s);

#endif
