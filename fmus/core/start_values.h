/* Start values that travel with a repaired FMU: resources/start_values.txt, first "guid = {...}", then "name = value", or
 * "name = value from t" for a parameter that changes at the time t (an effect that sets in during a run).
 * Importers may ignore start attributes of the XML, so the unit reads them itself. */
#ifndef COBOT_JOINT_START_VALUES_H
#define COBOT_JOINT_START_VALUES_H

#include <locale.h>
#include <stdlib.h>
#include <string.h>

#include "core/table.h"

typedef enum { START_NONE, START_APPLIED, START_BAD } StartFile;

/* a real parameter that takes its value only from a time on */
enum { MAX_LATE = 32 };
typedef struct {
  int n;
  struct {
    int reference;
    double value, from; /* s */
  } of[MAX_LATE];
} LateValues;

/* file URI (RFC 8089: file:///path, file:/path) or plain path -> path; %xx decoded */
static inline void uri_to_path(char *out, size_t size, const char *uri, const char *file) {
  if (strncmp(uri, "file:", 5) == 0) {
    uri += 5;
    if (strncmp(uri, "//", 2) == 0) {
      uri += 2;
      while (*uri && *uri != '/') uri++; /* host: empty or localhost */
    }
    if (uri[0] == '/' && uri[1] && uri[2] == ':') uri++; /* /C:/... */
  }
  size_t n = 0;
  for (; *uri && n + strlen(file) + 3 < size; uri++) {
    char hex[3] = {0};
    if (*uri == '%' && uri[1] && uri[2]) {
      memcpy(hex, uri + 1, 2);
      out[n++] = (char)strtol(hex, NULL, 16);
      uri += 2;
    } else {
      out[n++] = *uri;
    }
  }
  if (n > 0 && out[n - 1] != '/') out[n++] = '/';
  strcpy(out + n, file);
}

/* a number as C and Python write it; strtod wants the decimal point of the host's locale */
static inline bool read_number(const char *text, double *value) {
  const char *point = localeconv()->decimal_point;
  char local[160], *end = local;
  size_t n = 0;
  if (text[strspn(text, "+-.0123456789eE")] != 0 || strlen(text) * strlen(point) >= sizeof local) return false;
  for (; *text; text++)
    for (const char *c = *text == '.' ? point : text, *stop = *text == '.' ? point + strlen(point) : text + 1;
         c < stop;)
      local[n++] = *c++;
  local[n] = 0;
  *value = strtod(local, &end);
  return end != local && *end == 0 && isfinite(*value);
}

static inline bool set_start(Unit *m, const char *name, double value) {
  char known[NAME_SIZE];
  for (size_t i = 0; i < N_PUBLIC; i++) {
    const RealInfo *r = &REAL_INFO[i];
    if (strcmp(full_name(known, r->term, r->name), name) != 0) continue;
    if (!(value >= lowest(i) && value <= highest(i)) || r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL ||
        r->kind == IS_LOCAL)
      return false;
    reals(m)[i] = value;
    if (r->kind == IS_INPUT) m->u[i - FIRST_INPUT].c[0] = value;
    return true;
  }
  for (int i = 1; i < N_INTEGER; i++) {
    const DiscreteInfo *r = &INTEGER_INFO[i];
    const int max = r->options ? option_count(r->options) : r->max;
    if (strcmp(full_name(known, r->term, r->name), name) != 0) continue;
    if (r->kind != IS_PARAMETER || !(value >= r->min && value <= max)) return false;
    integers(m)[i] = (int)value;
    return true;
  }
  return false;
}

/* notes the value for later, if it could be a start value of a real parameter */
static inline bool set_late(LateValues *late, const Unit *m, const char *name, double value, double from) {
  char known[NAME_SIZE];
  for (int i = 0; i < N_PUBLIC && late->n < MAX_LATE; i++) {
    const RealInfo *r = &REAL_INFO[i];
    Unit probe = *m;
    if (strcmp(full_name(known, r->term, r->name), name) != 0) continue;
    if (r->kind != IS_PARAMETER || FIXED_INFO[i] || !set_start(&probe, name, value)) return false;
    late->of[late->n].reference = i;
    late->of[late->n].value = value;
    late->of[late->n++].from = from;
    return true;
  }
  return false;
}

/* parameters whose time has come; whether one changed */
static inline bool apply_late(const LateValues *late, Unit *m) {
  bool changed = false;
  for (int k = 0; k < late->n; k++) {
    if (m->changed >> k & 1 || m->time < late->of[k].from - 1e-9) continue;
    reals(m)[late->of[k].reference] = late->of[k].value;
    m->changed |= 1u << k;
    changed = true;
  }
  return changed;
}

/* when the next one comes */
static inline double next_late(const LateValues *late, const Unit *m) {
  double next = INFINITY;
  for (int k = 0; k < late->n; k++)
    if (!(m->changed >> k & 1)) next = fmin(next, late->of[k].from);
  return next;
}

/* the user's value stays */
static inline void forget_late(const LateValues *late, Unit *m, int reference) {
  for (int k = 0; k < late->n; k++)
    if (late->of[k].reference == reference) m->changed |= 1u << k;
}

/* resources/ of one instance into its start values, if the file's guid is the one asked for */
static inline StartFile read_start_values(Unit *m, LateValues *late, const char *resources, const char *guid,
                                          char why[256]) {
  char path[4096], line[256], name[NAME_SIZE], text[96], word[8], onset[96], more[2];
  if (!resources || strlen(resources) > 4000) return START_NONE;
  uri_to_path(path, sizeof path, resources, "start_values.txt");
  FILE *f = fopen(path, "r");
  if (!f) return START_NONE;
  StartFile result = START_BAD;
  if (fgets(line, sizeof line, f) && sscanf(line, "guid = %95s", text) == 1 && strcmp(text, guid) == 0) {
    result = START_APPLIED;
    while (result == START_APPLIED && fgets(line, sizeof line, f)) {
      double value = 0, from = 0;
      if (sscanf(line, " %95s", name) != 1 || name[0] == '#') continue;
      const int parts = sscanf(line, " %95s = %95s %7s %95s %1s", name, text, word, onset, more);
      const bool number = parts >= 2 && read_number(text, &value);
      const bool later = parts == 4 && strcmp(word, "from") == 0 && read_number(onset, &from);
      if (parts == 2 && number && set_start(m, name, value)) continue;
      if (later && number && set_late(late, m, name, value, from)) continue;
      line[strcspn(line, "\r\n")] = 0;
      snprintf(why, 256, "resources/start_values.txt: \"%.160s\" names no start value of a %s within its bounds", line,
               UNIT_NAME);
      result = START_BAD;
    }
  } else {
    snprintf(why, 256, "resources/start_values.txt is not for GUID %.80s", guid);
  }
  fclose(f);
  return result;
}

#endif
