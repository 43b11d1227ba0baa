/* Functions of FMI 3.0 that every unit has to have and for which none has anything: the part of fmi3.c that refuses. */
#ifndef COBOT_JOINT_ABSENT_H
#define COBOT_JOINT_ABSENT_H

static Status no_variables(Instance *c, const Reference vr[], size_t n) {
  if (n > 0) FAIL(c, "value reference %u: this unit has no variables of this type", vr ? vr[0] : 0);
  return OK;
}
static Status not_offered(Instance *c) { FAIL(c, "not offered, as modelDescription.xml says"); }

#define NO_VARIABLES(Type)                                                                                             \
  fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##Type value[],         \
                           size_t n_values) {                                                                          \
    (void)value, (void)n_values;                                                                                       \
    CALL(ANY, no_variables(instance, vr, n));                                                                          \
  }                                                                                                                    \
  fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3##Type value[],   \
                           size_t n_values) {                                                                          \
    (void)value, (void)n_values;                                                                                       \
    CALL(ANY, no_variables(instance, vr, n));                                                                          \
  }
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(UInt32)
NO_VARIABLES(UInt64)
NO_VARIABLES(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t size[],
                         fmi3Binary value[], size_t n_values) {
  (void)size, (void)value, (void)n_values;
  CALL(ANY, no_variables(instance, vr, n));
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t size[],
                         const fmi3Binary value[], size_t n_values) {
  (void)size, (void)value, (void)n_values;
  CALL(ANY, no_variables(instance, vr, n));
}

/* intervals and shifts of clocks: those that there are have theirs in modelDescription.xml, or none */
static Status no_interval(Instance *c, const Reference vr[], size_t n) {
  if (n > 0) FAIL(c, "value reference %u: no clock whose interval is asked or set", vr ? vr[0] : 0);
  return OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 interval[], fmi3IntervalQualifier qualifier[]) {
  (void)interval, (void)qualifier;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 interval[]) {
  (void)interval;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counter[],
                                   fmi3UInt64 resolution[], fmi3IntervalQualifier qualifier[]) {
  (void)counter, (void)resolution, (void)qualifier;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counter[], const fmi3UInt64 resolution[]) {
  (void)counter, (void)resolution;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shift[]) {
  (void)shift;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                               const fmi3Float64 shift[]) {
  (void)shift;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counter[],
                                fmi3UInt64 resolution[]) {
  (void)counter, (void)resolution;
  CALL(ANY, no_interval(instance, vr, n));
}
fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                const fmi3UInt64 counter[], const fmi3UInt64 resolution[]) {
  (void)counter, (void)resolution;
  CALL(ANY, no_interval(instance, vr, n));
}

/* dependencies of single elements, adjoint derivatives, configuration mode, evaluation of discrete states */
fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t *n) {
  (void)vr, (void)n;
  CALL(ANY, not_offered(instance));
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t element[],
                                       fmi3ValueReference independent[], size_t of_element[], fmi3DependencyKind kind[],
                                       size_t n) {
  (void)dependent, (void)element, (void)independent, (void)of_element, (void)kind, (void)n;
  CALL(ANY, not_offered(instance));
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknown[], size_t n_unknown,
                                    const fmi3ValueReference known[], size_t n_known, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
  (void)unknown, (void)n_unknown, (void)known, (void)n_known;
  (void)seed, (void)n_seed, (void)sensitivity, (void)n_sensitivity;
  CALL(ANY, not_offered(instance));
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { CALL(ANY, not_offered(instance)); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { CALL(ANY, not_offered(instance)); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) { CALL(ANY, not_offered(instance)); }

/* scheduled execution: not offered, but some importers (FMPy) want every function of the standard in a library */
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
                                               fmi3ClockUpdateCallback clock_update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
  (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock_update, (void)lock, (void)unlock;
  if (log_message)
    log_message(environment, fmi3Error, "logStatusError", "fmi3InstantiateScheduledExecution: not offered");
  return NULL;
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time) {
  (void)clock, (void)time;
  CALL(ANY, not_offered(instance));
}

#endif
