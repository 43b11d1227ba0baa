/* FMI 3.0 for model exchange: the part of fmi3.c in which the master integrates, as core/continuous.h has it. */
#ifndef COBOT_JOINT_EXCHANGE_H
#define COBOT_JOINT_EXCHANGE_H

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log_message) {
  (void)visible;
  Fmi3Instance c = {.core = {.log = fmi3_log, .call = __func__, .log_events = logging},
                    .environment = environment,
                    .log_message = log_message,
                    .logging = true, /* why there is no instance is told in any case */
                    .exchange = true};
  if (no_model_exchange()) {
    say(&c.core, REFUSED, "logStatusError", "only co-simulation is offered: %s", no_model_exchange());
    return NULL;
  }
  Fmi3Instance *fresh = new_instance(&c.core, sizeof c, name, token, resources);
  if (fresh) fresh->logging = logging;
  return fresh;
}

static Status only_exchange(Fmi3Instance *c) {
  if (!c->exchange) FAIL(&c->core, "only for model exchange");
  return OK;
}
#define EXCHANGE_CALL(phases, done)                                                                                    \
  return enter(instance, __func__, (phases)) != OK || only_exchange(instance) != OK ? fmi3Error : (fmi3Status)(done)

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) { EXCHANGE_CALL(EVENT, go(instance, CONTINUOUS)); }

static Status completed_step(Instance *c, fmi3Boolean *event, fmi3Boolean *terminate) {
  NEEDS_POINTER(event);
  NEEDS_POINTER(terminate);
  *event = *terminate = fmi3False;
  return OK;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_rollback, fmi3Boolean *event,
                                       fmi3Boolean *terminate) {
  (void)no_rollback;
  EXCHANGE_CALL(CONTINUOUS, completed_step(instance, event, terminate));
}
fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 t) { EXCHANGE_CALL(FMI3_EXCHANGED, set_time(instance, t)); }
fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n) {
  EXCHANGE_CALL(CONTINUOUS, set_continuous_states(instance, x, n));
}

enum { FMI3_ASKED = INITIALIZATION | FMI3_EXCHANGED | TERMINATED };

static Status get_settled_derivatives(Instance *c, double der[], size_t n) {
  const Status status = bring_up_to_date(c); /* FMI 3.0 allows the call while initializing */
  return status == OK ? get_derivatives(c, der, n) : status;
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 der[], size_t n) {
  EXCHANGE_CALL(FMI3_ASKED, get_settled_derivatives(instance, der, n));
}
fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 z[], size_t n) {
  EXCHANGE_CALL(FMI3_ASKED, get_event_indicators(instance, z, n));
}
fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n) {
  EXCHANGE_CALL(FMI3_ASKED, get_continuous_states(instance, x, n));
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominal[], size_t n) {
  EXCHANGE_CALL(FMI3_ASKED, get_nominals(instance, nominal, n));
}

static Status tell_number(Instance *c, size_t *n, size_t number) {
  NEEDS_POINTER(n);
  *n = number;
  return OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
  EXCHANGE_CALL(INSTANTIATED | FMI3_ASKED, tell_number(instance, n, N_EVENT));
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) {
  EXCHANGE_CALL(INSTANTIATED | FMI3_ASKED, tell_number(instance, n, N_X));
}
#undef EXCHANGE_CALL

#endif
