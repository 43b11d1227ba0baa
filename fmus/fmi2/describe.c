/* Prints what follows from a unit's table: `describe xml` its modelDescription.xml, `describe html` its reference page.
 * Built and run on the machine that builds, once per unit. */
#include "fmi2/table.h"

#include <string.h>

enum { TEXT_SIZE = 512 };

typedef struct {
  const char *name, *title, *equation, *source, *amplitude;
  double neutral;
} TermInfo; /* amplitude: NULL for a part that is always there */
static const TermInfo TERM_INFO[] = {
#define PART(name, title, equation, source) {#name, title, equation, source, NULL, 0},
#define TERM(name, title, equation, source, amplitude, neutral) {#name, title, equation, source, #amplitude, neutral},
#include "fmi2/rows.h"
    {NULL, NULL, NULL, NULL, NULL, 0}};

typedef struct {
  const char *term, *name, *scan;
  double from, to;
  int points;
} ShapeInfo;
static const ShapeInfo SHAPE_INFO[] = {
#define SHAPE(term, name, unit, start, min, max, from, to, scan, points, text) {#term, #name, #scan, from, to, points},
#include "fmi2/rows.h"
    {NULL, NULL, NULL, 0, 0, 0}};

typedef struct {
  const char *name, *phi, *w, *tau, *W, *W_abs, *role;
} FlangeInfo;
static const FlangeInfo FLANGE_INFO[] = {
#define FLANGE(name, phi, w, tau, W, W_abs, role) {#name, #phi, #w, #tau, #W, #W_abs, #role},
#include "fmi2/rows.h"
    {NULL, NULL, NULL, NULL, NULL, NULL, NULL}};

static const char *const UNIT_TITLE =
#define UNIT(name, title, text) title
#include "fmi2/rows.h"
    ;
static const char *const UNIT_TEXT =
#define UNIT(name, title, text) text
#include "fmi2/rows.h"
    ;

typedef struct {
  const char *name;
  int kg, m, s, A, K, rad;
  double factor;
} UnitOfMeasure;
static const UnitOfMeasure UNITS[] = {
#define UNIT_OF_MEASURE(name, kg, m, s, A, K, rad, factor) {name, kg, m, s, A, K, rad, factor},
#include "fmi2/units.def"
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
  for (int i = 0; i < N_STATE; i++)
    if (strcmp(REAL_INFO[i].unit, unit) == 0) return 1;
  return 0;
}

static int used(const char *unit) {
  char per_second[NAME_SIZE];
  for (int i = 0; i < N_PUBLIC; i++) {
    if (strcmp(REAL_INFO[i].unit, unit) == 0) return 1;
    if (i < N_STATE && strcmp(unit_per_second(per_second, REAL_INFO[i].unit), unit) == 0) return 1;
  }
  return 0;
}

static int known(const char *unit) {
  for (size_t i = 0; i < sizeof UNITS / sizeof *UNITS; i++)
    if (strcmp(UNITS[i].name, unit) == 0) return 1;
  return 0;
}

/* ---- modelDescription.xml -------------------------------------------------------------------------------------- */

static void scalar(const char *term, const char *name, unsigned reference, const char *text, const char *causality,
                   const char *variability, const char *initial) {
  char full[NAME_SIZE];
  printf("    <ScalarVariable name=\"%s\" valueReference=\"%u\"", full_name(full, term, name), reference);
  attribute("description", text);
  printf(" causality=\"%s\" variability=\"%s\"", causality, variability);
  if (initial) printf(" initial=\"%s\"", initial);
  printf(">");
}

static void xml_real(int i) {
  const RealInfo *r = &REAL_INFO[i];
  const int settable = r->kind == IS_STATE || r->kind == IS_INPUT || r->kind == IS_PARAMETER;
  const char *causality = r->kind == IS_STATE       ? r->feeds
                          : r->kind == IS_INPUT     ? "input"
                          : r->kind == IS_LOCAL     ? "local"
                          : r->kind == IS_PARAMETER ? "parameter"
                                                    : "output";
  scalar(r->term, r->name, (unsigned)i, r->text, causality,
         r->kind != IS_PARAMETER ? "continuous"
         : FIXED_INFO[i]         ? "fixed"
                                 : "tunable",
         r->kind == IS_INPUT ? NULL
         : settable          ? "exact"
                             : "calculated");
  printf("<Real unit=\"%s\"", r->unit);
  if (display_unit(r->unit)) printf(" displayUnit=\"%s\"", display_unit(r->unit)->name);
  if (lowest((size_t)i) > -DBL_MAX) printf(" min=\"%.17g\"", lowest((size_t)i));
  if (highest((size_t)i) < DBL_MAX) printf(" max=\"%.17g\"", highest((size_t)i));
  const double nominal = r->kind != IS_PARAMETER ? r->nominal : r->start != 0 ? fabs(r->start) : 1;
  printf(" nominal=\"%.17g\"", nominal);
  if (settable) printf(" start=\"%.17g\"", r->start);
  printf("/></ScalarVariable>\n");
}

/* the option at `*at`, which moves on behind it; NULL behind the last */
static const char *next_option(const char **at, int *length) {
  const char *option = *at;
  if (!*option) return NULL;
  *length = (int)strcspn(option, "|");
  *at += *length + (option[*length] == '|');
  return option;
}

/* "which model (1 averaged, 2 simscape)": with names that every importer shows, since some refuse enumerations */
static const char *with_options(char out[TEXT_SIZE], const DiscreteInfo *r) {
  if (!r->options) return r->text;
  int used = snprintf(out, TEXT_SIZE, "%s (", r->text), length;
  const char *at = r->options, *option;
  for (int n = 1; used < TEXT_SIZE && (option = next_option(&at, &length)) != NULL; n++)
    used += snprintf(out + used, (size_t)(TEXT_SIZE - used), "%d %.*s%s", n, length, option, *at ? ", " : ")");
  return out;
}

static void xml_integer(int i) {
  const DiscreteInfo *r = &INTEGER_INFO[i];
  const int parameter = r->kind == IS_PARAMETER;
  char text[TEXT_SIZE];
  scalar(r->term, r->name, (unsigned)i, with_options(text, r), parameter ? "parameter" : "output",
         parameter ? "fixed" : "discrete", parameter ? "exact" : "calculated");
  printf("<Integer min=\"%d\" max=\"%d\"", r->min, r->options ? option_count(r->options) : r->max);
  if (parameter) printf(" start=\"%d\"", r->start);
  printf("/></ScalarVariable>\n");
}

static void xml_boolean(int i) {
  const DiscreteInfo *r = &BOOLEAN_INFO[i];
  const int input = r->kind == IS_INPUT;
  scalar(r->term, r->name, (unsigned)i, r->text, input ? "input" : "output", "discrete", input ? NULL : "calculated");
  printf(input ? "<Boolean start=\"%s\"/></ScalarVariable>\n" : "<Boolean/></ScalarVariable>\n",
         r->start ? "true" : "false");
}

/* of a state, behind all other variables */
static void xml_derivative(int i) {
  char name[NAME_SIZE], text[NAME_SIZE], unit[NAME_SIZE];
  snprintf(name, sizeof name, "der(%s)", REAL_INFO[i].name);
  snprintf(text, sizeof text, "derivative of %s", REAL_INFO[i].name);
  scalar("", name, (unsigned)(FIRST_DER + i), text, "local", "continuous", "calculated");
  printf("<Real unit=\"%s\"", unit_per_second(unit, REAL_INFO[i].unit));
  if (display_unit(unit)) printf(" displayUnit=\"%s\"", display_unit(unit)->name);
  printf(" derivative=\"%d\" nominal=\"%.17g\"/></ScalarVariable>\n", i + 1, REAL_INFO[i].nominal);
}

/* index in ModelVariables, from 1 */
static int index_of_derivative(int i) { return N_PUBLIC + N_INTEGER - 1 + N_BOOLEAN - 1 + i + 1; }

static int is_output(int i) {
  const RealInfo *r = &REAL_INFO[i];
  return r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL || (r->kind == IS_STATE && strcmp(r->feeds, "output") == 0);
}

/* index in ModelVariables, from 1: reals, then integers, then Booleans */
static int index_of_input(const char *name, size_t length) {
  for (int i = FIRST_INPUT; i < FIRST_INPUT + N_INPUT; i++)
    if (strlen(REAL_INFO[i].name) == length && strncmp(REAL_INFO[i].name, name, length) == 0) return i + 1;
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_INPUT && strlen(BOOLEAN_INFO[i].name) == length &&
        strncmp(BOOLEAN_INFO[i].name, name, length) == 0)
      return N_PUBLIC + N_INTEGER - 1 + i;
  fprintf(stderr, "%s: an output names the feed-through \"%.*s\", which is no input\n", UNIT_NAME, (int)length, name);
  return -1;
}

/* an output depends on the inputs it feeds through and, unless it is one, on states */
static int xml_unknown(int index, const char *feeds) {
  int bad = 0;
  const char *sep = "";
  printf("      <Unknown index=\"%d\" dependencies=\"", index);
  for (int i = 1; i <= N_STATE; i++) {
    if (index <= N_STATE && index != i) continue;
    printf("%s%d", sep, i);
    sep = " ";
  }
  for (; *feeds; sep = " ") {
    const size_t length = strcspn(feeds, " ");
    const int input = index_of_input(feeds, length);
    bad |= input < 0;
    printf("%s%d", sep, input);
    feeds += length + (feeds[length] == ' ');
  }
  printf("\"/>\n");
  return bad;
}

static int xml_structure(void) {
  int bad = 0;
  printf("  <ModelStructure>\n    <Outputs>\n");
  for (int i = 0; i < N_PUBLIC; i++)
    if (is_output(i)) bad |= xml_unknown(i + 1, REAL_INFO[i].kind == IS_OUTPUT ? REAL_INFO[i].feeds : "");
  for (int i = 1; i < N_INTEGER; i++)
    if (INTEGER_INFO[i].kind == IS_OUTPUT) bad |= xml_unknown(N_PUBLIC + i, INTEGER_INFO[i].feeds);
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_OUTPUT) bad |= xml_unknown(N_PUBLIC + N_INTEGER - 1 + i, BOOLEAN_INFO[i].feeds);
  printf("    </Outputs>\n");
  if (N_STATE > 0) printf("    <Derivatives>\n");
  for (int i = 0; i < N_STATE; i++) printf("      <Unknown index=\"%d\"/>\n", index_of_derivative(i));
  if (N_STATE > 0) printf("    </Derivatives>\n");
  printf("    <InitialUnknowns>\n");
  for (int i = 0; i < N_PUBLIC; i++)
    if (REAL_INFO[i].kind != IS_STATE && is_output(i)) printf("      <Unknown index=\"%d\"/>\n", i + 1);
  for (int i = 1; i < N_INTEGER; i++)
    if (INTEGER_INFO[i].kind == IS_OUTPUT) printf("      <Unknown index=\"%d\"/>\n", N_PUBLIC + i);
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_OUTPUT) printf("      <Unknown index=\"%d\"/>\n", N_PUBLIC + N_INTEGER - 1 + i);
  for (int i = 0; i < N_STATE; i++) printf("      <Unknown index=\"%d\"/>\n", index_of_derivative(i));
  printf("    </InitialUnknowns>\n  </ModelStructure>\n");
  return bad;
}

/* Integers whose values have names */
static void xml_choices(void) {
  char full[NAME_SIZE];
  int length;
  for (int i = 1; i < N_INTEGER; i++) {
    const DiscreteInfo *r = &INTEGER_INFO[i];
    if (!r->options) continue;
    printf("      <Choice name=\"%s\">", full_name(full, r->term, r->name));
    const char *at = r->options, *option;
    for (int n = 1; (option = next_option(&at, &length)) != NULL; n++)
      printf("<Item name=\"%.*s\" value=\"%d\"/>", length, option, n);
    printf("</Choice>\n");
  }
}

static void xml_annotations(void) {
  char full[NAME_SIZE];
  printf("  <VendorAnnotations>\n    <Tool name=\"cobot-joint\"><Physics>\n");
  for (const TermInfo *t = TERM_INFO; t->name; t++) {
    printf("      <%s name=\"%s\"", t->amplitude ? "Term" : "Part", t->name);
    attribute("title", t->title);
    attribute("equation", t->equation);
    attribute("source", t->source);
    if (t->amplitude) printf(" amplitude=\"%s\" neutral=\"%.17g\"", full_name(full, t->name, t->amplitude), t->neutral);
    printf(">\n");
    for (const ShapeInfo *s = SHAPE_INFO; s->term; s++)
      if (strcmp(s->term, t->name) == 0)
        printf("        <Shape name=\"%s\" min=\"%.17g\" max=\"%.17g\" scan=\"%s\" points=\"%d\"/>\n",
               full_name(full, s->term, s->name), s->from, s->to, s->scan, s->points);
    printf("      </%s>\n", t->amplitude ? "Term" : "Part");
  }
  for (const FlangeInfo *f = FLANGE_INFO; f->name; f++)
    printf("      <Flange name=\"%s\" phi=\"%s\" w=\"%s\" tau=\"%s\" W=\"%s\" W_abs=\"%s\" role=\"%s\"/>\n", f->name,
           f->phi, f->w, f->tau, f->W, f->W_abs, f->role);
  xml_choices();
  printf("    </Physics></Tool>\n  </VendorAnnotations>\n");
}

static void xml_unit(const char *name, const UnitOfMeasure *u, int per_second) {
  printf("    <Unit name=\"%s\"><BaseUnit", name);
  exponent("kg", u->kg);
  exponent("m", u->m);
  exponent("s", u->s - per_second);
  exponent("A", u->A);
  exponent("K", u->K);
  exponent("rad", u->rad);
  if (u->factor != 1) printf(" factor=\"%.17g\"", u->factor);
  printf("/>");
  const DisplayUnit *d = display_unit(name);
  if (d) printf("<DisplayUnit name=\"%s\" factor=\"%.17g\"/>", d->name, d->factor);
  printf("</Unit>\n");
}

static int xml(const char *version) {
  int bad = 0;
  printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"%s\" "
         "guid=\"%s\"",
         UNIT_NAME, UNIT_GUID);
  attribute("description", UNIT_TEXT);
  printf(" author=\"the cobot-joint developers\" version=\"%s\" license=\"BSD-2-Clause\" generationTool=\"cobot-joint\""
         " variableNamingConvention=\"structured\" numberOfEventIndicators=\"0\">\n",
         version);
  printf("  <CoSimulation modelIdentifier=\"%s\" canHandleVariableCommunicationStepSize=\"true\" "
         "canInterpolateInputs=\"true\""
         " maxOutputDerivativeOrder=\"1\" canNotUseMemoryManagementFunctions=\"true\" canGetAndSetFMUstate=\"true\""
         " canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\">\n"
         "    <SourceFiles><File name=\"all.c\"/></SourceFiles>\n  </CoSimulation>\n",
         UNIT_NAME);
  printf("  <UnitDefinitions>\n");
  for (size_t i = 0; i < sizeof UNITS / sizeof *UNITS; i++) {
    char per_second[NAME_SIZE];
    if (used(UNITS[i].name)) xml_unit(UNITS[i].name, &UNITS[i], 0);
    if (is_of_state(UNITS[i].name) && !known(unit_per_second(per_second, UNITS[i].name)))
      xml_unit(per_second, &UNITS[i], 1);
  }
  printf("  </UnitDefinitions>\n");
  printf("  <LogCategories><Category name=\"logStatusError\" description=\"why a call was refused or failed\"/>"
         "<Category name=\"logStatusDiscard\" description=\"why a value or a step was not taken\"/>"
         "<Category name=\"logEvents\" description=\"located events\"/></LogCategories>\n");
  printf("  <DefaultExperiment startTime=\"0\" stopTime=\"1\" tolerance=\"1e-06\" stepSize=\"0.001\"/>\n");
  xml_annotations();
  printf("  <ModelVariables>\n");
  for (int i = 0; i < N_PUBLIC; i++) {
    if (!known(REAL_INFO[i].unit)) {
      fprintf(stderr, "%s: unit of measure \"%s\" of %s is not in fmi2/units.def\n", UNIT_NAME, REAL_INFO[i].unit,
              REAL_INFO[i].name);
      bad = 1;
    }
    xml_real(i);
  }
  for (int i = 1; i < N_INTEGER; i++) xml_integer(i);
  for (int i = 1; i < N_BOOLEAN; i++) xml_boolean(i);
  for (int i = 0; i < N_STATE; i++) xml_derivative(i);
  printf("  </ModelVariables>\n");
  bad |= xml_structure();
  printf("</fmiModelDescription>\n");
  return bad;
}

#include "fmi2/reference_page.h"

int main(int argc, char *argv[]) {
  if (argc == 3 && strcmp(argv[1], "xml") == 0) return xml(argv[2]);
  if (argc == 3 && strcmp(argv[1], "html") == 0) return html(argv[2]);
  fprintf(stderr, "describe: usage: describe xml|html VERSION\n");
  return 2;
}
