/* The unit's table as data: what describe.c prints and fmi2.c checks against. Order as in unit.h. */
#ifndef COBOT_JOINT_TABLE_H
#define COBOT_JOINT_TABLE_H

#include <float.h>
#include <stdio.h>

#include "fmi2/unit.h"

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
  const char *options; /* enumeration: its items, else NULL */
  const char *text, *feeds;
} DiscreteInfo;

static const RealInfo REAL_INFO[] = {
#define STATE(name, unit, nominal, causality, text)                                                                    \
  {IS_STATE, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, #causality},
#include "fmi2/rows.h"
#define INTEGRAL(name, unit, nominal, text)                                                                            \
  {IS_INTEGRAL, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, "output"},
#include "fmi2/rows.h"
#define INPUT(name, unit, start, nominal, text)                                                                        \
  {IS_INPUT, "", #name, unit, start, -DBL_MAX, DBL_MAX, nominal, text, ""},
#include "fmi2/rows.h"
#define OUTPUT(name, unit, nominal, feeds, text)                                                                       \
  {IS_OUTPUT, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, feeds},
#include "fmi2/rows.h"
#define LOCAL(name, unit, nominal, text) {IS_LOCAL, "", #name, unit, 0, -DBL_MAX, DBL_MAX, nominal, text, ""},
#include "fmi2/rows.h"
#define PARAMETER(term, name, unit, start, min, max, text)                                                             \
  {IS_PARAMETER, #term, #name, unit, start, min, max, 1, text, ""},
#define SHAPE(term, name, unit, start, min, max, from, to, scan, points, text)                                         \
  {IS_PARAMETER, #term, #name, unit, start, min, max, 1, text, ""},
#include "fmi2/rows.h"
};

static const DiscreteInfo INTEGER_INFO[] = {
    {IS_LOCAL, "", "", 0, 0, 0, NULL, "", ""},
#define CHOICE(term, name, start, options, text) {IS_PARAMETER, #term, #name, start, 1, 99, options, text, ""},
#define COUNT(term, name, start, min, max, text) {IS_PARAMETER, #term, #name, start, min, max, NULL, text, ""},
#define CODE(name, min, max, feeds, text) {IS_OUTPUT, "", #name, 0, min, max, NULL, text, feeds},
#include "fmi2/rows.h"
};

static const DiscreteInfo BOOLEAN_INFO[] = {
    {IS_LOCAL, "", "", 0, 0, 1, NULL, "", ""},
#define SWITCH(name, start, text) {IS_INPUT, "", #name, start, 0, 1, NULL, text, ""},
#define SIGNAL(name, feeds, text) {IS_OUTPUT, "", #name, 0, 0, 1, NULL, text, feeds},
#include "fmi2/rows.h"
};

static const char *const UNIT_NAME =
#define UNIT(name, title, text) #name
#include "fmi2/rows.h"
    ;

enum { NAME_SIZE = 96, GUID_SIZE = 40 };

/* structured name, FMI 2.0 2.2.9: term.name */
static inline const char *full_name(char out[NAME_SIZE], const char *term, const char *name) {
  snprintf(out, NAME_SIZE, "%s%s%s", term, *term ? "." : "", name);
  return out;
}

/* how many items an enumeration has */
static inline int option_count(const char *options) {
  int n = 1;
  for (; *options; options++) n += *options == '|';
  return n;
}

/* FNV-1a, the 128-bit GUID as two 64-bit streams */
static inline void hash_text(uint64_t h[2], const char *text) {
  for (; *text; text++) {
    h[0] = (h[0] ^ (unsigned char)*text) * 1099511628211u;
    h[1] = (h[1] + (unsigned char)*text) * 1099511628211u + 17;
  }
}

/* "{xxxxxxxx-xxxx-...}": a hash of the whole table, so XML and library can only match when both come from it */
static inline void table_guid(char out[GUID_SIZE]) {
  uint64_t h[2] = {14695981039346656037u, 1099511628211u};
  char row[512];
  hash_text(h, UNIT_NAME);
  for (int i = 0; i < N_PUBLIC; i++) {
    const RealInfo *r = &REAL_INFO[i];
    snprintf(row, sizeof row, "%d %s.%s %s %.17g %.17g %.17g %.17g %s", (int)r->kind, r->term, r->name, r->unit,
             r->start, r->min, r->max, r->nominal, r->feeds);
    hash_text(h, row);
  }
  for (int i = 1; i < N_INTEGER; i++) {
    const DiscreteInfo *r = &INTEGER_INFO[i];
    snprintf(row, sizeof row, "I%d %s.%s %d %d %d %s", (int)r->kind, r->term, r->name, r->start, r->min, r->max,
             r->options ? r->options : "");
    hash_text(h, row);
  }
  for (int i = 1; i < N_BOOLEAN; i++) {
    snprintf(row, sizeof row, "B%d %s %d", (int)BOOLEAN_INFO[i].kind, BOOLEAN_INFO[i].name, BOOLEAN_INFO[i].start);
    hash_text(h, row);
  }
  snprintf(out, GUID_SIZE, "{%08x-%04x-%04x-%04x-%08x%04x}", (unsigned)(h[0] >> 32), (unsigned)(h[0] >> 16) & 0xffffu,
           (unsigned)h[0] & 0xffffu, (unsigned)(h[1] >> 48) & 0xffffu, (unsigned)(h[1] >> 16),
           (unsigned)h[1] & 0xffffu);
}

#endif
