/* The unit's table as data: what describe.c prints and fmi2.c checks against. Order as in unit.h. */
#ifndef COBOT_JOINT_TABLE_H
#define COBOT_JOINT_TABLE_H

#include <float.h>
#include <stdio.h>

#include "core/unit.h"

/* "{...}": a hash of all sources, so that XML and library only match when both come from the same equations */
#ifndef UNIT_GUID
#error "UNIT_GUID is defined by the file that includes fmi2.c, all.c; the build writes it"
#endif

typedef enum { IS_STATE, IS_INTEGRAL, IS_INPUT, IS_OUTPUT, IS_LOCAL, IS_PARAMETER } Kind;

typedef struct {
  Kind kind;
  const char *term, *name, *unit;
  double start, min, max, nominal;
  const char *text;  /* description */
  const char *feeds; /* output: the inputs fed through; state: its causality */
} RealInfo;

typedef struct {
  Kind kind;
  const char *term, *name;
  int start, min, max;
  const char *options; /* of a CHOICE, else NULL */
  const char *text, *feeds;
} DiscreteInfo;

static const RealInfo REAL_INFO[] = {
#define STATE(name, unit, nominal, causality, text)                                                                    \
  {IS_STATE, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, #causality},
#include "core/rows.h"
#define INTEGRAL(name, unit, nominal, text)                                                                            \
  {IS_INTEGRAL, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, "output"},
#include "core/rows.h"
#define INPUT(name, unit, start, nominal, text)                                                                        \
  {IS_INPUT, "", #name, unit, start, -DBL_MAX, DBL_MAX, nominal, text, ""},
#include "core/rows.h"
#define OUTPUT(name, unit, nominal, feeds, text)                                                                       \
  {IS_OUTPUT, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, feeds},
#include "core/rows.h"
#define LOCAL(name, unit, nominal, text) {IS_LOCAL, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, ""},
#include "core/rows.h"
#define PARAMETER(term, name, unit, start, min, max, text)                                                             \
  {IS_PARAMETER, #term, #name, unit, start, min, max, 1, text, ""},
#define SHAPE(term, name, unit, start, min, max, from, to, scan, points, text)                                         \
  {IS_PARAMETER, #term, #name, unit, start, min, max, 1, text, ""},
#include "core/rows.h"
};

/* of states and inputs; parameters have theirs above */
static const struct {
  bool given;
  double min, max;
} BOUNDS_INFO[N_PUBLIC + 1] = {
#define BOUNDS(name, min, max) [VR_##name] = {true, min, max},
#include "core/rows.h"
    [N_PUBLIC] = {false, 0, 0}};
static const bool FIXED_INFO[N_PUBLIC + 1] = {
#define FIXED(parameter) [VR_##parameter] = true,
#include "core/rows.h"
    [N_PUBLIC] = false};
static inline double lowest(size_t i) { return BOUNDS_INFO[i].given ? BOUNDS_INFO[i].min : REAL_INFO[i].min; }
static inline double highest(size_t i) { return BOUNDS_INFO[i].given ? BOUNDS_INFO[i].max : REAL_INFO[i].max; }

static const DiscreteInfo INTEGER_INFO[] = {
    {IS_LOCAL, "", "", 0, 0, 0, NULL, "", ""},
#define CHOICE(term, name, start, options, text) {IS_PARAMETER, #term, #name, start, 1, 99, options, text, ""},
#define COUNT(term, name, start, min, max, text) {IS_PARAMETER, #term, #name, start, min, max, NULL, text, ""},
#define CODE(name, min, max, feeds, text) {IS_OUTPUT, "", #name, 0, min, max, NULL, text, feeds},
#include "core/rows.h"
};

static const DiscreteInfo BOOLEAN_INFO[] = {
    {IS_LOCAL, "", "", 0, 0, 1, NULL, "", ""},
#define SWITCH(name, start, text) {IS_INPUT, "", #name, start, 0, 1, NULL, text, ""},
#define SIGNAL(name, feeds, text) {IS_OUTPUT, "", #name, 0, 0, 1, NULL, text, feeds},
#include "core/rows.h"
};

static const char *const UNIT_NAME =
#define UNIT(name, title, text) #name
#include "core/rows.h"
    ;

enum { NAME_SIZE = 96, GUID_SIZE = sizeof UNIT_GUID };

/* structured name, FMI 2.0 2.2.9: term.name */
static inline const char *full_name(char out[NAME_SIZE], const char *term, const char *name) {
  snprintf(out, NAME_SIZE, "%s%s%s", term, *term ? "." : "", name);
  return out;
}

/* how many options a CHOICE has */
static inline int option_count(const char *options) {
  int n = 1;
  for (; *options; options++) n += *options == '|';
  return n;
}

#endif
