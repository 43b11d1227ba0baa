/* FMU states: a copy of the unit; and the same as bytes. */
#ifndef COBOT_JOINT_STATES_H
#define COBOT_JOINT_STATES_H

#include "core/instance.h"

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
  STATE_VERSION = 4
}; /* version: counts changes of Snapshot and of what stands before it */

static bool is_state(const Snapshot *s) {
  return s->magic == STATE_MAGIC && s->version == STATE_VERSION && s->size == sizeof *s && phase_name(s->phase) != NULL;
}

static Status get_state(Instance *c, void **state) {
  NEEDS_POINTER(state);
  Snapshot *s = *state ? *state : calloc(1, sizeof *s); /* zeros: what pads it is serialized, too */
  if (!s) FAIL(c, "out of memory");
  s->magic = STATE_MAGIC;
  s->version = STATE_VERSION;
  s->size = sizeof *s;
  s->phase = c->phase;
  s->stop_time = c->stop_time;
  copy_unit(&s->unit, &c->unit);
  *state = s;
  return OK;
}

static Status set_state(Instance *c, const void *state) {
  NEEDS_POINTER(state);
  const Snapshot *s = state;
  if (!is_state(s)) FAIL(c, "this is no state of a %s", UNIT_NAME);
  c->phase = s->phase;
  c->stop_time = s->stop_time;
  copy_unit(&c->unit, &s->unit);
  return OK;
}

static Status free_state(void **state) {
  if (!state) return OK;
  free(*state);
  *state = NULL;
  return OK;
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

static Status serialized_size(Instance *c, const void *state, size_t *size) {
  NEEDS_POINTER(state);
  NEEDS_POINTER(size);
  *size = STATE_BYTES;
  return OK;
}

static Status serialize_state(Instance *c, const void *state, void *bytes, size_t size) {
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (!is_state(state)) FAIL(c, "this is no state of a %s", UNIT_NAME);
  if (size < STATE_BYTES) FAIL(c, "%u bytes given, %u needed", (unsigned)size, (unsigned)STATE_BYTES);
  const uint64_t hash = hash_of(state);
  memcpy(bytes, UNIT_GUID, GUID_SIZE);
  memcpy((char *)bytes + GUID_SIZE, &hash, sizeof hash);
  memcpy((char *)bytes + GUID_SIZE + sizeof hash, state, sizeof(Snapshot));
  return OK;
}

static Status deserialize_state(Instance *c, const void *bytes, size_t size, void **state) {
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (size < STATE_BYTES || memcmp(bytes, UNIT_GUID, GUID_SIZE) != 0)
    FAIL(c, "these %u bytes are no state of a %s %s", (unsigned)size, UNIT_NAME, UNIT_GUID);
  uint64_t hash;
  Snapshot *fresh = malloc(sizeof *fresh);
  if (!fresh) FAIL(c, "out of memory");
  memcpy(&hash, (const char *)bytes + GUID_SIZE, sizeof hash);
  memcpy(fresh, (const char *)bytes + GUID_SIZE + sizeof hash, sizeof *fresh);
  if (hash != hash_of(fresh) || !is_state(fresh)) {
    free(fresh);
    FAIL(c, "the bytes are damaged");
  }
  free(*state);
  *state = fresh;
  return OK;
}

#endif
