/* Prints what follows from a unit's table: `describe xml 2|3` its modelDescription.xml of FMI 2.0 or 3.0,
 * `describe html 2|3` its reference page.
 * Built and run on the machine that builds, once per unit. */
#include "core/table.h"

#include <string.h>

enum { TEXT_SIZE = 512 };

typedef struct {
  const char *name, *title, *equation, *source, *amplitude;
  double neutral;
} TermInfo; /* amplitude: NULL for a part that is always there */
static const TermInfo TERM_INFO[] = {
#define PART(name, title, equation, source) {#name, title, equation, source, NULL, 0},
#define TERM(name, title, equation, source, amplitude, neutral) {#name, title, equation, source, #amplitude, neutral},
#include "core/rows.h"
    {NULL, NULL, NULL, NULL, NULL, 0}};

typedef struct {
  const char *term, *name, *scan;
  double from, to;
  int points;
} ShapeInfo;
static const ShapeInfo SHAPE_INFO[] = {
#define SHAPE(term, name, unit, start, min, max, from, to, scan, points, text) {#term, #name, #scan, from, to, points},
#include "core/rows.h"
    {NULL, NULL, NULL, 0, 0, 0}};

typedef struct {
  const char *name, *phi, *w, *tau, *W, *W_abs, *role;
} FlangeInfo;
static const FlangeInfo FLANGE_INFO[] = {
#define FLANGE(name, phi, w, tau, W, W_abs, role) {#name, #phi, #w, #tau, #W, #W_abs, #role},
#include "core/rows.h"
    {NULL, NULL, NULL, NULL, NULL, NULL, NULL}};

static const char *const UNIT_TITLE =
#define UNIT(name, title, text) title
#include "core/rows.h"
    ;
static const char *const UNIT_TEXT =
#define UNIT(name, title, text) text
#include "core/rows.h"
    ;

typedef struct {
  const char *name;
  int kg, m, s, A, K, rad;
  double factor;
} UnitOfMeasure;
static const UnitOfMeasure UNITS[] = {
#define UNIT_OF_MEASURE(name, kg, m, s, A, K, rad, factor) {name, kg, m, s, A, K, rad, factor},
#include "describe/units.def"
};

/* as people read angles and speeds */
typedef struct {
  const char *unit, *name;
  double factor;
} DisplayUnit;
static const DisplayUnit *display_unit(const char *unit) {
  static const DisplayUnit ALL[] = {{"rad", "deg", 180 / PI}, {"rad/s", "rpm", 30 / PI}};
  for (size_t i = 0; i < sizeof ALL / sizeof *ALL; i++)
    if (strcmp(ALL[i].unit, unit) == 0) return &ALL[i];
  return NULL;
}

static void escaped(const char *text) {
  for (; *text; text++) switch (*text) {
      case '<': fputs("&lt;", stdout); break;
      case '>': fputs("&gt;", stdout); break;
      case '&': fputs("&amp;", stdout); break;
      case '"': fputs("&quot;", stdout); break;
      default: putchar(*text);
    }
}

static void attribute(const char *name, const char *value) {
  printf(" %s=\"", name);
  escaped(value);
  putchar('"');
}

static void exponent(const char *name, int n) {
  if (n) printf(" %s=\"%d\"", name, n);
}

/* of the derivative of what has this unit: (rad/s)/s */
static const char *unit_per_second(char out[NAME_SIZE], const char *unit) {
  const int fraction = strchr(unit, '/') != NULL;
  snprintf(out, NAME_SIZE, "%s%s%s/s", fraction ? "(" : "", unit, fraction ? ")" : "");
  return out;
}

static int is_of_state(const char *unit) {
  for (int i = 0; i < N_X; i++)
    if (strcmp(REAL_INFO[i].unit, unit) == 0) return 1;
  return 0;
}

static int used(const char *unit) {
  char per_second[NAME_SIZE];
  for (int i = 0; i < N_PUBLIC; i++) {
    if (strcmp(REAL_INFO[i].unit, unit) == 0) return 1;
    if (i < N_X && strcmp(unit_per_second(per_second, REAL_INFO[i].unit), unit) == 0) return 1;
  }
  return 0;
}

static int known(const char *unit) {
  for (size_t i = 0; i < sizeof UNITS / sizeof *UNITS; i++)
    if (strcmp(UNITS[i].name, unit) == 0) return 1;
  return 0;
}

#include "describe/shared.h"
#include "describe/reference_page.h"
#include "describe/fmi2.h"
#include "describe/fmi3.h"

int main(int argc, char *argv[]) {
  if (argc == 4 && (strcmp(argv[2], "2") == 0 || strcmp(argv[2], "3") == 0)) {
    const int three = *argv[2] == '3';
    if (strcmp(argv[1], "xml") == 0) return three ? xml_fmi3(argv[3]) : xml_fmi2(argv[3]);
    if (strcmp(argv[1], "html") == 0) return html(three ? "3.0" : "2.0", argv[3]);
  }
  fprintf(stderr, "describe: usage: describe xml|html 2|3 VERSION\n");
  return 2;
}
