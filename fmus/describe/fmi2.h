/* modelDescription.xml of FMI 2.0: the part of describe.c that prints it. */
#ifndef COBOT_JOINT_FMI2_DESCRIPTION_H
#define COBOT_JOINT_FMI2_DESCRIPTION_H

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
  scalar(r->term, r->name, (unsigned)i, r->text, causality_of(r), variability_of(i), initial_of(r));
  printf("<Real");
  real_attributes(i);
  printf("/></ScalarVariable>\n");
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
  printf("<Real");
  unit_attributes(unit_per_second(unit, REAL_INFO[i].unit));
  printf(" derivative=\"%d\" nominal=\"%.17g\"/></ScalarVariable>\n", i + 1, REAL_INFO[i].nominal);
}

/* indices in ModelVariables, from 1: reals, Integers, Booleans, derivatives */
static const Numbering FMI2_NUMBERING = {.attribute = "index",
                                         .output = "Unknown",
                                         .derivative = "Unknown",
                                         .initial = "Unknown",
                                         .real = 1,
                                         .integer = N_PUBLIC,
                                         .boolean = N_PUBLIC + N_INTEGER - 1,
                                         .first_derivative = N_PUBLIC + N_INTEGER + N_BOOLEAN - 1};

static int xml_structure(void) {
  const Numbering *by = &FMI2_NUMBERING;
  printf("  <ModelStructure>\n    <Outputs>\n");
  const int bad = xml_outputs(by);
  printf("    </Outputs>\n");
  if (N_X > 0) printf("    <Derivatives>\n");
  xml_derivatives(by, by->derivative);
  if (N_X > 0) printf("    </Derivatives>\n");
  printf("    <InitialUnknowns>\n");
  xml_initial_unknowns(by);
  printf("    </InitialUnknowns>\n  </ModelStructure>\n");
  return bad;
}

enum {
  SAMPLES_AT_STEPS = 0
#define SAMPLES_STEPS(what) +1
#include "core/rows.h"
};

static int xml_fmi2(const char *version) {
  printf("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"%s\" "
         "guid=\"%s\"",
         UNIT_NAME, UNIT_GUID);
  attribute("description", UNIT_TEXT);
  printf(" author=\"the cobot-joint developers\" version=\"%s\" license=\"BSD-2-Clause\" generationTool=\"cobot-joint\""
         " variableNamingConvention=\"structured\" numberOfEventIndicators=\"%d\">\n",
         version, (int)N_EVENT);
  if (!SAMPLES_AT_STEPS)
    printf("  <ModelExchange modelIdentifier=\"%s\" completedIntegratorStepNotNeeded=\"true\""
           " canNotUseMemoryManagementFunctions=\"true\" canGetAndSetFMUstate=\"true\""
           " canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\">\n"
           "    <SourceFiles><File name=\"all.c\"/></SourceFiles>\n  </ModelExchange>\n",
           UNIT_NAME);
  printf("  <CoSimulation modelIdentifier=\"%s\" canHandleVariableCommunicationStepSize=\"true\" "
         "canInterpolateInputs=\"true\""
         " maxOutputDerivativeOrder=\"1\" canNotUseMemoryManagementFunctions=\"true\" canGetAndSetFMUstate=\"true\""
         " canSerializeFMUstate=\"true\" providesDirectionalDerivative=\"true\">\n"
         "    <SourceFiles><File name=\"all.c\"/></SourceFiles>\n  </CoSimulation>\n",
         UNIT_NAME);
  int bad = xml_units();
  xml_log_and_experiment();
  printf("  <VendorAnnotations>\n    <Tool name=\"cobot-joint\">");
  xml_physics();
  printf("</Tool>\n  </VendorAnnotations>\n");
  printf("  <ModelVariables>\n");
  for (int i = 0; i < N_PUBLIC; i++) xml_real(i);
  for (int i = 1; i < N_INTEGER; i++) xml_integer(i);
  for (int i = 1; i < N_BOOLEAN; i++) xml_boolean(i);
  for (int i = 0; i < N_X; i++) xml_derivative(i);
  printf("  </ModelVariables>\n");
  bad |= xml_structure();
  printf("</fmiModelDescription>\n");
  return bad;
}

#endif
