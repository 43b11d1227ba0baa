/* modelDescription.xml of FMI 3.0: the part of describe.c that prints it. */
#ifndef COBOT_JOINT_FMI3_DESCRIPTION_H
#define COBOT_JOINT_FMI3_DESCRIPTION_H

#include "fmi3/references.h"

/* what all variables have; attributes of the type follow, and the element's end */
static void variable(const char *type, const char *term, const char *name, int reference, const char *text) {
  char full[NAME_SIZE];
  printf("    <%s name=\"%s\" valueReference=\"%d\"", type, full_name(full, term, name), reference);
  attribute("description", text);
}

static void kind(const char *causality, const char *variability, const char *initial) {
  printf(" causality=\"%s\" variability=\"%s\"", causality, variability);
  if (initial) printf(" initial=\"%s\"", initial);
}

static void xml_float(int i) {
  const RealInfo *r = &REAL_INFO[i];
  variable("Float64", r->term, r->name, i, r->text);
  kind(causality_of(r), variability_of(i), initial_of(r));
  if (r->kind == IS_INPUT || is_output(i)) printf(" intermediateUpdate=\"true\"");
  real_attributes(i);
  printf("/>\n");
}

static void xml_derivative_float(int i) {
  char name[NAME_SIZE], text[NAME_SIZE], unit[NAME_SIZE];
  snprintf(name, sizeof name, "der(%s)", REAL_INFO[i].name);
  snprintf(text, sizeof text, "derivative of %s", REAL_INFO[i].name);
  variable("Float64", "", name, FIRST_DER + i, text);
  kind("local", "continuous", "calculated");
  unit_attributes(unit_per_second(unit, REAL_INFO[i].unit));
  printf(" derivative=\"%d\" nominal=\"%.17g\"/>\n", i, REAL_INFO[i].nominal);
}

/* of a choice; no variable is called so */
enum { TYPE_NAME_SIZE = NAME_SIZE + 8 };
static const char *type_name(char out[TYPE_NAME_SIZE], const DiscreteInfo *r) {
  snprintf(out, TYPE_NAME_SIZE, "%s%s%s.Type", r->term, *r->term ? "." : "", r->name);
  return out;
}

static void xml_types(void) {
  char name[TYPE_NAME_SIZE];
  int any = 0, length;
  for (int i = 1; i < N_INTEGER; i++) {
    const DiscreteInfo *r = &INTEGER_INFO[i];
    if (!r->options) continue;
    if (!any++) printf("  <TypeDefinitions>\n");
    printf("    <EnumerationType name=\"%s\"", type_name(name, r));
    attribute("description", r->text);
    printf(">");
    const char *at = r->options, *option;
    for (int n = 1; (option = next_option(&at, &length)) != NULL; n++)
      printf("<Item name=\"%.*s\" value=\"%d\"/>", length, option, n);
    printf("</EnumerationType>\n");
  }
  if (any) printf("  </TypeDefinitions>\n");
}

static void xml_int32_or_enumeration(int i) {
  const DiscreteInfo *r = &INTEGER_INFO[i];
  const int parameter = r->kind == IS_PARAMETER;
  char type[TYPE_NAME_SIZE];
  variable(r->options ? "Enumeration" : "Int32", r->term, r->name, FMI3_INTEGER + i, r->text);
  kind(parameter ? "parameter" : "output", parameter ? "fixed" : "discrete", parameter ? "exact" : "calculated");
  if (r->options)
    printf(" declaredType=\"%s\"", type_name(type, r));
  else
    printf(" min=\"%d\" max=\"%d\"", r->min, r->max);
  if (parameter) printf(" start=\"%d\"", r->start);
  printf("/>\n");
}

static void xml_bool(int i) {
  const DiscreteInfo *r = &BOOLEAN_INFO[i];
  const int input = r->kind == IS_INPUT;
  variable("Boolean", r->term, r->name, FMI3_BOOLEAN + i, r->text);
  kind(input ? "input" : "output", "discrete", input ? NULL : "calculated");
  if (input) printf(" start=\"%s\"", r->start ? "true" : "false");
  printf("/>\n");
}

/* FMI 3.0, 2.4.8: what turns positive where the unit has an event is a variable */
static void xml_indicators(void) {
  int reference = FMI3_INDICATOR;
#define EVENT(name, text)                                                                                              \
  variable("Float64", "", "z_" #name, reference++, "positive where " text);                                            \
  kind("local", "continuous", "calculated");                                                                           \
  printf("/>\n");
#include "core/rows.h"
  (void)reference;
}

static void xml_clock(const char *name, int number, const char *text, const char *causality, const char *interval) {
  variable("Clock", "", name, FMI3_CLOCK + number, text);
  kind(causality, "discrete", NULL);
  printf(" intervalVariability=\"%s\"", interval);
  if (strcmp(interval, "constant") == 0) printf(" intervalDecimal=\"%.17g\" shiftDecimal=\"0\"", SAMPLE_PERIOD);
  printf("/>\n");
}

static void xml_clocks(void) {
#define CLOCK(name, ticks, text) xml_clock(#name, CLOCK_##name, text, "output", "triggered");
#define SAMPLE_CLOCK(name, text) xml_clock(#name, CLOCK_##name, text, "input", "constant");
#include "core/rows.h"
}

static void xml_clocks_among(const char *element) {
  (void)element;
#define CLOCK(name, ...) printf("      <%s valueReference=\"%d\"/>\n", element, FMI3_CLOCK + CLOCK_##name);
#include "core/rows.h"
}

static const Numbering FMI3_NUMBERING = {.attribute = "valueReference",
                                         .output = "Output",
                                         .derivative = "ContinuousStateDerivative",
                                         .initial = "InitialUnknown",
                                         .real = 0,
                                         .integer = FMI3_INTEGER,
                                         .boolean = FMI3_BOOLEAN,
                                         .first_derivative = FIRST_DER};

static void xml_model_exchange(void) {
  printf("  <ModelExchange modelIdentifier=\"%s\" canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\""
         " providesDirectionalDerivatives=\"true\" needsCompletedIntegratorStep=\"false\"/>\n",
         UNIT_NAME);
}

/* event mode: in units that have events */
static void xml_cosimulation(void) {
  printf("  <CoSimulation modelIdentifier=\"%s\" canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\""
         " providesDirectionalDerivatives=\"true\" canHandleVariableCommunicationStepSize=\"true\""
         " maxOutputDerivativeOrder=\"1\" providesIntermediateUpdate=\"true\" mightReturnEarlyFromDoStep=\"true\""
         " canReturnEarlyAfterIntermediateUpdate=\"true\" hasEventMode=\"%s\"/>\n",
         UNIT_NAME, N_EVENT > 0 ? "true" : "false");
}

static int xml_fmi3(const char *version) {
  const Numbering *by = &FMI3_NUMBERING;
  printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"%s\" "
         "instantiationToken=\"%s\"",
         UNIT_NAME, UNIT_GUID);
  attribute("description", UNIT_TEXT);
  printf(" author=\"the cobot-joint developers\" version=\"%s\" license=\"BSD-2-Clause\""
         " generationTool=\"cobot-joint\" variableNamingConvention=\"structured\">\n",
         version);
  if (!SAMPLES_AT_STEPS) xml_model_exchange();
  xml_cosimulation();
  int bad = xml_units();
  xml_types();
  xml_log_and_experiment();
  printf("  <ModelVariables>\n");
  variable("Float64", "", "time", FMI3_TIME, "time");
  kind("independent", "continuous", NULL);
  printf("/>\n");
  for (int i = 0; i < N_PUBLIC; i++) xml_float(i);
  for (int i = 1; i < N_INTEGER; i++) xml_int32_or_enumeration(i);
  for (int i = 1; i < N_BOOLEAN; i++) xml_bool(i);
  for (int i = 0; i < N_X; i++) xml_derivative_float(i);
  if (!SAMPLES_AT_STEPS) xml_indicators();
  xml_clocks();
  printf("  </ModelVariables>\n  <ModelStructure>\n");
  bad |= xml_outputs(by);
  xml_clocks_among(by->output);
  xml_derivatives(by, by->derivative);
  xml_initial_unknowns(by);
  xml_clocks_among(by->initial);
  for (int k = 0; k < N_EVENT && !SAMPLES_AT_STEPS; k++)
    printf("      <EventIndicator valueReference=\"%d\"/>\n", FMI3_INDICATOR + k);
  printf("  </ModelStructure>\n  <Annotations>\n    <Annotation type=\"cobot-joint\">");
  xml_physics();
  printf("</Annotation>\n  </Annotations>\n</fmiModelDescription>\n");
  return bad;
}

#endif
