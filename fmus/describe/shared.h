/* What the descriptions of all versions of FMI share: the part of describe.c that prints it. */
#ifndef COBOT_JOINT_DESCRIPTION_H
#define COBOT_JOINT_DESCRIPTION_H

static const char *causality_of(const RealInfo *r) {
  switch (r->kind) {
    case IS_STATE: return r->feeds;
    case IS_INPUT: return "input";
    case IS_LOCAL: return "local";
    case IS_PARAMETER: return "parameter";
    default: return "output";
  }
}

static const char *variability_of(int i) {
  return REAL_INFO[i].kind != IS_PARAMETER ? "continuous" : FIXED_INFO[i] ? "fixed" : "tunable";
}

static int has_start(const RealInfo *r) {
  return r->kind == IS_STATE || r->kind == IS_INPUT || r->kind == IS_PARAMETER;
}

/* NULL: an input's goes without saying */
static const char *initial_of(const RealInfo *r) {
  return r->kind == IS_INPUT ? NULL : has_start(r) ? "exact" : "calculated";
}

static void unit_attributes(const char *unit) {
  printf(" unit=\"%s\"", unit);
  if (display_unit(unit)) printf(" displayUnit=\"%s\"", display_unit(unit)->name);
}

static void real_attributes(int i) {
  const RealInfo *r = &REAL_INFO[i];
  unit_attributes(r->unit);
  if (lowest((size_t)i) > -DBL_MAX) printf(" min=\"%.17g\"", lowest((size_t)i));
  if (highest((size_t)i) < DBL_MAX) printf(" max=\"%.17g\"", highest((size_t)i));
  printf(" nominal=\"%.17g\"", r->kind != IS_PARAMETER ? r->nominal : r->start != 0 ? fabs(r->start) : 1);
  if (has_start(r)) printf(" start=\"%.17g\"", r->start);
  if (r->kind == IS_STATE && N_EVENT > 0) printf(" reinit=\"true\"");
}

/* the option at `*at`, which moves on behind it; NULL behind the last */
static const char *next_option(const char **at, int *length) {
  const char *option = *at;
  if (!*option) return NULL;
  *length = (int)strcspn(option, "|");
  *at += *length + (option[*length] == '|');
  return option;
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

/* for our own tools: terms, flanges, names of choices */
static void xml_physics(void) {
  char full[NAME_SIZE];
  printf("<Physics>\n");
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
  printf("    </Physics>");
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

static int xml_units(void) {
  int bad = 0;
  for (int i = 0; i < N_PUBLIC; i++)
    if (!known(REAL_INFO[i].unit)) {
      fprintf(stderr, "%s: unit of measure \"%s\" of %s is not in describe/units.def\n", UNIT_NAME, REAL_INFO[i].unit,
              REAL_INFO[i].name);
      bad = 1;
    }
  printf("  <UnitDefinitions>\n");
  for (size_t i = 0; i < sizeof UNITS / sizeof *UNITS; i++) {
    char per_second[NAME_SIZE];
    if (used(UNITS[i].name)) xml_unit(UNITS[i].name, &UNITS[i], 0);
    if (is_of_state(UNITS[i].name) && !known(unit_per_second(per_second, UNITS[i].name)))
      xml_unit(per_second, &UNITS[i], 1);
  }
  printf("  </UnitDefinitions>\n");
  return bad;
}

static void xml_log_and_experiment(void) {
  printf("  <LogCategories><Category name=\"logStatusError\" description=\"why a call was refused or failed\"/>"
         "<Category name=\"logStatusDiscard\" description=\"why a value or a step was not taken\"/>"
         "<Category name=\"logEvents\" description=\"located events\"/></LogCategories>\n");
  printf("  <DefaultExperiment startTime=\"0\" stopTime=\"1\" tolerance=\"1e-06\" stepSize=\"0.001\"/>\n");
}

/* ---- ModelStructure --------------------------------------------------------------------------------------------- */

/* how a version numbers variables: the first real and derivative, and what stands before the first Integer and Boolean */
typedef struct {
  const char *attribute, *output, *derivative, *initial;
  int real, integer, boolean, first_derivative;
} Numbering;

static int is_output(int i) {
  const RealInfo *r = &REAL_INFO[i];
  return r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL || (r->kind == IS_STATE && strcmp(r->feeds, "output") == 0);
}

static int number_of_input(const Numbering *by, const char *name, size_t length) {
  for (int i = FIRST_INPUT; i < FIRST_INPUT + N_INPUT; i++)
    if (strlen(REAL_INFO[i].name) == length && strncmp(REAL_INFO[i].name, name, length) == 0) return by->real + i;
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_INPUT && strlen(BOOLEAN_INFO[i].name) == length &&
        strncmp(BOOLEAN_INFO[i].name, name, length) == 0)
      return by->boolean + i;
  fprintf(stderr, "%s: an output names the feed-through \"%.*s\", which is no input\n", UNIT_NAME, (int)length, name);
  return -1;
}

/* an output depends on the inputs it feeds through and, unless it is one (state: its index, else -1), on states */
static int xml_output(const Numbering *by, int number, int state, const char *feeds) {
  int bad = 0;
  const char *sep = "";
  printf("      <%s %s=\"%d\" dependencies=\"", by->output, by->attribute, number);
  for (int i = 0; i < N_X; i++) {
    if (state >= 0 ? i != state : i >= N_STATE) continue; /* nothing depends on an integral but itself */
    printf("%s%d", sep, by->real + i);
    sep = " ";
  }
  for (; *feeds; sep = " ") {
    const size_t length = strcspn(feeds, " ");
    const int input = number_of_input(by, feeds, length);
    bad |= input < 0;
    printf("%s%d", sep, input);
    feeds += length + (feeds[length] == ' ');
  }
  printf("\"/>\n");
  return bad;
}

static int xml_outputs(const Numbering *by) {
  int bad = 0;
  for (int i = 0; i < N_PUBLIC; i++)
    if (is_output(i))
      bad |= xml_output(by, by->real + i, i < N_X ? i : -1, REAL_INFO[i].kind == IS_OUTPUT ? REAL_INFO[i].feeds : "");
  for (int i = 1; i < N_INTEGER; i++)
    if (INTEGER_INFO[i].kind == IS_OUTPUT) bad |= xml_output(by, by->integer + i, -1, INTEGER_INFO[i].feeds);
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_OUTPUT) bad |= xml_output(by, by->boolean + i, -1, BOOLEAN_INFO[i].feeds);
  return bad;
}

static void xml_derivatives(const Numbering *by, const char *element) {
  for (int i = 0; i < N_X; i++) printf("      <%s %s=\"%d\"/>\n", element, by->attribute, by->first_derivative + i);
}

static void xml_initial_unknowns(const Numbering *by) {
  for (int i = 0; i < N_PUBLIC; i++)
    if (REAL_INFO[i].kind != IS_STATE && is_output(i))
      printf("      <%s %s=\"%d\"/>\n", by->initial, by->attribute, by->real + i);
  for (int i = 1; i < N_INTEGER; i++)
    if (INTEGER_INFO[i].kind == IS_OUTPUT)
      printf("      <%s %s=\"%d\"/>\n", by->initial, by->attribute, by->integer + i);
  for (int i = 1; i < N_BOOLEAN; i++)
    if (BOOLEAN_INFO[i].kind == IS_OUTPUT)
      printf("      <%s %s=\"%d\"/>\n", by->initial, by->attribute, by->boolean + i);
  xml_derivatives(by, by->initial);
}

#endif
