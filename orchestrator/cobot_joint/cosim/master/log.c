/* Messages of the units, formatted and kept without Python: a unit may log in the middle of native stepping. */
#include <stdarg.h>
#include <stdio.h>

#include "cosim.h"

void cosim_log(fmi2ComponentEnvironment log, fmi2String instance, fmi2Status status, fmi2String category,
               fmi2String message, ...) {
  (void)instance, (void)category;
  if (!log || !message || status == fmi2OK) return;
  Log *kept = log;
  va_list arguments;
  va_start(arguments, message);
  vsnprintf(kept->last, sizeof kept->last, message, arguments);
  va_end(arguments);
}
