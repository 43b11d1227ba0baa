/* The reference page of a unit, documentation/index.html: the part of describe.c that prints it. */
#ifndef COBOT_JOINT_REFERENCE_PAGE_H
#define COBOT_JOINT_REFERENCE_PAGE_H

#include "describe/page_style.h"

typedef struct {
  const char *id, *title;
  Kind kind;
} Section;

static const Section PORTS[] = {{"inputs", "Inputs", IS_INPUT},
                                {"states", "States", IS_STATE},
                                {"outputs", "Outputs", IS_OUTPUT},
                                {"work-at-the-ports", "Work at the ports", IS_INTEGRAL},
                                {"settings", "Settings of the unit", IS_PARAMETER}};
enum { N_PORTS = sizeof PORTS / sizeof *PORTS };
/* terms by whether they are optional */
static const Section TERMS[] = {{"base-model", "Base model", IS_PARAMETER},
                                {"optional-terms", "Terms that can be switched on", IS_PARAMETER}};

/* name, value or unit with what is allowed below it, meaning */
static void html_row(const char *name, const char *value, const char *allowed, const char *text) {
  printf("<tr><td>");
  for (const char *at = name; *at; at++)
    printf(*at == '_' || *at == '.' ? "%c<wbr>" : "%c", *at); /* where it may break */
  printf("</td><td>");
  escaped(value);
  if (*allowed) printf("<small>%s</small>", allowed);
  printf("</td><td>");
  escaped(text);
  printf("</td></tr>\n");
}

static void real_row(const RealInfo *r) {
  char full[NAME_SIZE], value[96] = "", allowed[96] = "";
  if (r->kind == IS_PARAMETER) {
    snprintf(value, sizeof value, "%g%s%s", r->start, strcmp(r->unit, "1") == 0 ? "" : " ",
             strcmp(r->unit, "1") == 0 ? "" : r->unit);
    snprintf(allowed, sizeof allowed, "%g to %g", r->min, r->max);
  }
  html_row(full_name(full, r->term, r->name), *value ? value : r->unit, allowed, r->text);
}

/* a count with its range, a choice with the names of its values */
static void discrete_row(const DiscreteInfo *r, const char *type) {
  char full[NAME_SIZE], value[96], allowed[512] = "";
  snprintf(value, sizeof value, "%s", type);
  if (r->kind == IS_PARAMETER) snprintf(value, sizeof value, "%d", r->start);
  if (r->kind == IS_PARAMETER && !r->options) snprintf(allowed, sizeof allowed, "%d to %d", r->min, r->max);
  const char *at = r->options ? r->options : "", *option;
  int length, end = 0;
  for (int n = 1; (option = next_option(&at, &length)) != NULL; n++)
    end += snprintf(allowed + end, sizeof allowed - (size_t)end, "%s%d %.*s", n > 1 ? ", " : "", n, length, option);
  html_row(full_name(full, r->term, r->name), value, allowed, r->text);
}

static int has_term(const char *name) {
  for (const TermInfo *t = TERM_INFO; t->name; t++)
    if (strcmp(t->name, name) == 0) return 1;
  return 0;
}

/* of this term, or of the unit itself ("") with what has a term's name but is of none */
static int belongs(const char *of, const char *term) {
  return strcmp(of, term) == 0 || (!*term && *of && !has_term(of));
}

/* the rows of a term, or of the unit itself (""); returns how many, and prints them only if asked to */
static int html_rows(const char *term, Kind kind, int print) {
  int n = 0;
  for (int i = 0; i < N_PUBLIC; i++) {
    if (REAL_INFO[i].kind != kind || !belongs(REAL_INFO[i].term, term)) continue;
    if (print) real_row(&REAL_INFO[i]);
    n++;
  }
  const DiscreteInfo *sets[] = {INTEGER_INFO, BOOLEAN_INFO};
  const int counts[] = {N_INTEGER, N_BOOLEAN};
  for (int s = 0; s < 2; s++)
    for (int i = 1; i < counts[s]; i++) {
      if (sets[s][i].kind != kind || !belongs(sets[s][i].term, term)) continue;
      if (print) discrete_row(&sets[s][i], s == 0 ? "Integer" : "Boolean");
      n++;
    }
  return n;
}

static void html_table(const char *term, Kind kind) {
  if (html_rows(term, kind, 0) == 0) return;
  printf("<table>\n<thead><tr><th>name</th><th>%s</th><th>meaning</th></tr></thead>\n<tbody>\n",
         kind == IS_PARAMETER ? "value, range" : "unit");
  html_rows(term, kind, 1);
  printf("</tbody>\n</table>\n");
}

static void html_heading(const Section *s) {
  printf("<h2 id=\"%s\">%s<a class=\"anchor\" href=\"#%s\" aria-label=\"link to %s\">#</a></h2>\n", s->id, s->title,
         s->id, s->title);
}

static void html_term(const TermInfo *t) {
  printf("<h3 id=\"%s\">%s: ", t->name, t->name);
  escaped(t->title);
  printf("<a class=\"anchor\" href=\"#%s\" aria-label=\"link to %s\">#</a></h3>\n<p class=\"equation\"><code>", t->name,
         t->name);
  escaped(t->equation);
  printf("</code></p>\n<p class=\"source\">Source: ");
  escaped(t->source);
  printf("</p>\n");
  html_table(t->name, IS_PARAMETER);
}

static int is_in(const TermInfo *t, int optional) { return (t->amplitude != NULL) == optional; }

static int has_terms(int optional) {
  for (const TermInfo *t = TERM_INFO; t->name; t++)
    if (is_in(t, optional)) return 1;
  return 0;
}

static void html_contents(void) {
  printf("<nav aria-label=\"Contents\">\n<ul>\n");
  for (int s = 0; s < N_PORTS; s++)
    if (html_rows("", PORTS[s].kind, 0)) printf("<li><a href=\"#%s\">%s</a></li>\n", PORTS[s].id, PORTS[s].title);
  for (int optional = 0; optional < 2; optional++) {
    if (!has_terms(optional)) continue;
    printf("<li><a href=\"#%s\">%s</a>\n<ul>\n", TERMS[optional].id, TERMS[optional].title);
    for (const TermInfo *t = TERM_INFO; t->name; t++)
      if (is_in(t, optional)) printf("<li><a href=\"#%s\">%s</a></li>\n", t->name, t->name);
    printf("</ul></li>\n");
  }
  printf("</ul>\n</nav>\n");
}

/* icon: where this version of FMI keeps it */
static void html_title(const char *fmi, const char *version) {
  const char *icon = *fmi == '3' ? "../terminalsAndIcons/icon.png" : "../model.png";
  printf("<header>\n<img src=\"%s\" alt=\"Icon of %s\">\n<h1>%s</h1>\n<p>", icon, UNIT_NAME, UNIT_NAME);
  escaped(UNIT_TITLE);
  printf(". ");
  escaped(UNIT_TEXT);
  printf("</p>\n<p>FMI %s co-simulation, version %s, GUID <code>%s</code>. SI units. Every term is off at its neutral "
         "value.</p>\n</header>\n",
         fmi, version, UNIT_GUID);
}

static int html(const char *fmi, const char *version) {
  printf("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
         "<meta name=\"viewport\" content=\"width=device-width, "
         "initial-scale=1\"><title>%s</title>\n<style>\n%s</style></head>\n<body>\n",
         UNIT_NAME, PAGE_STYLE);
  html_contents();
  printf("<main>\n");
  html_title(fmi, version);
  for (int s = 0; s < N_PORTS; s++) {
    if (html_rows("", PORTS[s].kind, 0) == 0) continue;
    html_heading(&PORTS[s]);
    html_table("", PORTS[s].kind);
  }
  for (int optional = 0; optional < 2; optional++) {
    if (!has_terms(optional)) continue;
    html_heading(&TERMS[optional]);
    for (const TermInfo *t = TERM_INFO; t->name; t++)
      if (is_in(t, optional)) html_term(t);
  }
  printf("</main>\n</body></html>\n");
  return 0;
}

#endif
