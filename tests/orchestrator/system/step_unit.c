/* A unit's library, loaded as an importer does and stepped with moving inputs: its outputs as exact numbers, a line each.
 * step_unit LIBRARY GUID INPUT,INPUT,... OUTPUT,OUTPUT,...   (value references) */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"

#ifdef _WIN32
#include <windows.h>
#define LOAD(path) ((void *)LoadLibraryA(path))
#define SYMBOL(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define LOAD(path) dlopen(path, RTLD_NOW)
#define SYMBOL dlsym
#endif

enum { MOST = 100, STEPS = 300 };

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
  (void)e, (void)category;
  fprintf(stderr, "%s: %d: %s\n", name, status, message);
}

static size_t numbers(const char *list, fmi2ValueReference found[]) {
  size_t n = 0;
  for (char *end; *list && n < MOST; list = *end ? end + 1 : end)
    found[n++] = (fmi2ValueReference)strtoul(list, &end, 10);
  return n;
}

#define FUNCTION(name) name##TYPE *name = (name##TYPE *)SYMBOL(library, #name)
#define OK(call)                                                                                                       \
  if ((call) > fmi2Warning) return fprintf(stderr, "%s\n", #call), 1

int main(int n, char **argument) {
  if (n != 5) return 2;
  void *library = LOAD(argument[1]);
  if (!library) return fprintf(stderr, "%s cannot be loaded\n", argument[1]), 1;
  FUNCTION(fmi2Instantiate);
  FUNCTION(fmi2SetupExperiment);
  FUNCTION(fmi2EnterInitializationMode);
  FUNCTION(fmi2ExitInitializationMode);
  FUNCTION(fmi2SetReal);
  FUNCTION(fmi2GetReal);
  FUNCTION(fmi2DoStep);
  FUNCTION(fmi2Terminate);
  FUNCTION(fmi2FreeInstance);
  fmi2ValueReference input[MOST], output[MOST];
  const size_t inputs = numbers(argument[3], input), outputs = numbers(argument[4], output);
  const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
  fmi2Component c = fmi2Instantiate("unit", fmi2CoSimulation, argument[2], "", &callbacks, 0, 0);
  if (!c) return fprintf(stderr, "fmi2Instantiate\n"), 1;
  OK(fmi2SetupExperiment(c, 0, 0, 0, 0, 0));
  OK(fmi2EnterInitializationMode(c));
  OK(fmi2ExitInitializationMode(c));
  for (int k = 0; k < STEPS; k++) {
    double y[MOST];
    for (size_t j = 0; j < inputs; j++) {
      const double u = 0.1 * sin(1e-3 * k * (3 + (double)j));
      OK(fmi2SetReal(c, &input[j], 1, &u));
    }
    OK(fmi2DoStep(c, 1e-3 * k, 1e-3, fmi2True));
    OK(fmi2GetReal(c, output, outputs, y));
    for (size_t j = 0; j < outputs; j++) printf("%a ", y[j]);
    printf("\n");
  }
  OK(fmi2Terminate(c));
  fmi2FreeInstance(c);
  return 0;
}
