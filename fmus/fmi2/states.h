/* FMU states: a copy of the unit; and the same as bytes. */
#ifndef COBOT_JOINT_STATES_H
#define COBOT_JOINT_STATES_H

#include "fmi2/instance.h"

/* what an FMU state keeps; late values stay those of the instance, from its resources */
typedef struct {
  uint32_t magic, version;
  uint64_t size;
  Phase phase;
  double stop_time;
  Unit unit;
} Snapshot;
enum {
  STATE_MAGIC = 0x636a3031,
  STATE_VERSION = 3
}; /* version: counts changes of Snapshot and of what stands before it */

static bool is_phase(Phase phase) {
  return phase == INSTANTIATED || phase == INITIALIZATION || phase == STEPPING || phase == TERMINATED ||
         phase == FAILED || phase == STOPPED_SHORT;
}

static bool is_state(const Snapshot *s) {
  return s->magic == STATE_MAGIC && s->version == STATE_VERSION && s->size == sizeof *s && is_phase(s->phase);
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  Snapshot *s = *state ? *state : calloc(1, sizeof *s); /* zeros: what pads it is serialized, too */
  if (!s) FAIL(c, "fmi2GetFMUstate: out of memory");
  s->magic = STATE_MAGIC;
  s->version = STATE_VERSION;
  s->size = sizeof *s;
  s->phase = c->phase;
  s->stop_time = c->stop_time;
  s->unit = c->unit;
  *state = s;
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  const Snapshot *s = state;
  if (!is_state(s)) FAIL(c, "fmi2SetFMUstate: this is no state of a %s", UNIT_NAME);
  c->phase = s->phase;
  c->stop_time = s->stop_time;
  c->unit = s->unit;
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
  NEEDS(ANY);
  if (!state) return fmi2OK;
  free(*state);
  *state = NULL;
  return fmi2OK;
}

/* Bytes: GUID, hash of the snapshot, snapshot; readable by the same build of the same unit. */
enum { STATE_BYTES = GUID_SIZE + sizeof(uint64_t) + sizeof(Snapshot) };

/* FNV-1a, draft-eastlake-fnv, 64 bits: finds damage, not forgery */
static uint64_t hash_of(const Snapshot *s) {
  const unsigned char *bytes = (const unsigned char *)s;
  uint64_t h = 14695981039346656037u;
  for (size_t i = 0; i < sizeof *s; i++) h = (h ^ bytes[i]) * 1099511628211u;
  return h;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(size);
  *size = STATE_BYTES;
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (!is_state(state)) FAIL(c, "fmi2SerializeFMUstate: this is no state of a %s", UNIT_NAME);
  if (size < STATE_BYTES)
    FAIL(c, "fmi2SerializeFMUstate: %u bytes given, %u needed", (unsigned)size, (unsigned)STATE_BYTES);
  const uint64_t hash = hash_of(state);
  memcpy(bytes, UNIT_GUID, GUID_SIZE);
  memcpy(bytes + GUID_SIZE, &hash, sizeof hash);
  memcpy(bytes + GUID_SIZE + sizeof hash, state, sizeof(Snapshot));
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (size < STATE_BYTES || memcmp(bytes, UNIT_GUID, GUID_SIZE) != 0)
    FAIL(c, "fmi2DeSerializeFMUstate: these %u bytes are no state of a %s %s", (unsigned)size, UNIT_NAME, UNIT_GUID);
  uint64_t hash;
  Snapshot *fresh = malloc(sizeof *fresh);
  if (!fresh) FAIL(c, "fmi2DeSerializeFMUstate: out of memory");
  memcpy(&hash, bytes + GUID_SIZE, sizeof hash);
  memcpy(fresh, bytes + GUID_SIZE + sizeof hash, sizeof *fresh);
  if (hash != hash_of(fresh) || !is_state(fresh)) {
    free(fresh);
    FAIL(c, "fmi2DeSerializeFMUstate: the bytes are damaged");
  }
  free(*state);
  *state = fresh;
  return fmi2OK;
}

#endif
