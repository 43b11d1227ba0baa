/* FMU states: a copy of the unit; and the same as bytes. */
#ifndef COBOT_JOINT_STATES_H
#define COBOT_JOINT_STATES_H

#include "fmi2/instance.h"

/* what an FMU state keeps */
typedef struct {
  uint32_t magic, size;
  Phase phase;
  Unit unit;
} Snapshot;
enum { STATE_MAGIC = 0x636a3031 };

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  Snapshot *s = *state ? *state : malloc(sizeof *s);
  if (!s) FAIL(c, "fmi2GetFMUstate: out of memory");
  *s = (Snapshot){.magic = STATE_MAGIC, .size = sizeof *s, .phase = c->phase, .unit = c->unit};
  *state = s;
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  const Snapshot *s = state;
  if (s->magic != STATE_MAGIC || s->size != sizeof *s) FAIL(c, "fmi2SetFMUstate: this is no state of a %s", UNIT_NAME);
  c->phase = s->phase;
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

/* bytes: GUID, then the snapshot; readable by the same build of the same unit */
fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(size);
  *size = GUID_SIZE + sizeof(Snapshot);
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (size < GUID_SIZE + sizeof(Snapshot))
    FAIL(c, "fmi2SerializeFMUstate: %u bytes given, %u needed", (unsigned)size,
         (unsigned)(GUID_SIZE + sizeof(Snapshot)));
  char guid[GUID_SIZE] = "";
  table_guid(guid);
  memcpy(bytes, guid, GUID_SIZE);
  memcpy(bytes + GUID_SIZE, state, sizeof(Snapshot));
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  char guid[GUID_SIZE] = "";
  table_guid(guid);
  Snapshot s;
  if (size < GUID_SIZE + sizeof s || memcmp(bytes, guid, GUID_SIZE) != 0)
    FAIL(c, "fmi2DeSerializeFMUstate: these %u bytes are no state of a %s %s", (unsigned)size, UNIT_NAME, guid);
  memcpy(&s, bytes + GUID_SIZE, sizeof s);
  if (s.magic != STATE_MAGIC || s.size != sizeof s || !(s.phase & ANY))
    FAIL(c, "fmi2DeSerializeFMUstate: the bytes are damaged");
  Snapshot *fresh = *state ? *state : malloc(sizeof s);
  if (!fresh) FAIL(c, "fmi2DeSerializeFMUstate: out of memory");
  *fresh = s;
  *state = fresh;
  return fmi2OK;
}

#endif
