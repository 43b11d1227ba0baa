/* The reference page of a unit, documentation/index.html: the part of describe.c that prints it. */
#ifndef COBOT_JOINT_REFERENCE_PAGE_H
#define COBOT_JOINT_REFERENCE_PAGE_H

static void cell(const char *text) {
  printf("<td>");
  escaped(text);
  printf("</td>");
}

/* "first|second" as "first, second", which a line can break */
static void options_cell(const char *options) {
  printf("<td>");
  for (const char *at = options; *at; at++)
    if (*at == '|')
      printf(", ");
    else
      putchar(*at);
  printf("</td>");
}

static void html_rows(const char *term, Kind kind) {
  char full[NAME_SIZE], range[96] = "";
  for (int i = 0; i < N_PUBLIC; i++) {
    const RealInfo *r = &REAL_INFO[i];
    if (r->kind != kind || strcmp(r->term, term) != 0) continue;
    if (kind == IS_PARAMETER) snprintf(range, sizeof range, "%g (%g to %g)", r->start, r->min, r->max);
    printf("<tr>");
    cell(full_name(full, r->term, r->name));
    cell(range);
    cell(r->unit);
    cell(r->text);
    printf("</tr>\n");
  }
  const DiscreteInfo *sets[] = {INTEGER_INFO, BOOLEAN_INFO};
  const int counts[] = {N_INTEGER, N_BOOLEAN};
  for (int s = 0; s < 2; s++)
    for (int i = 1; i < counts[s]; i++) {
      const DiscreteInfo *r = &sets[s][i];
      if (r->kind != kind || strcmp(r->term, term) != 0) continue;
      printf("<tr>");
      cell(full_name(full, r->term, r->name));
      options_cell(r->options ? r->options : "");
      cell(s == 0 ? "Integer" : "Boolean");
      cell(r->text);
      printf("</tr>\n");
    }
}

static void html_ports(const char *title, Kind kind) {
  printf("<h2>%s</h2>\n<table>\n", title);
  html_rows("", kind);
  printf("</table>\n");
}

static int html(const char *fmi, const char *version) {
  printf("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>%s</title>\n"
         "<style>body{font:16px/1.5 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 "
         "1em}table{border-collapse:collapse}"
         "td{padding:.2em .8em .2em 0;vertical-align:top;border-bottom:1px solid "
         "#ddd}code{background:#f4f4f4;padding:.1em .3em}"
         "img{float:right;width:128px}</style></head>\n<body>\n<img src=\"model.png\" alt=\"\">\n<h1>%s</h1>\n<p>",
         UNIT_NAME, UNIT_NAME);
  escaped(UNIT_TITLE);
  printf(". ");
  escaped(UNIT_TEXT);
  printf("</p>\n<p>FMI %s co-simulation, version %s, GUID <code>%s</code>. SI units. Every term is off at its neutral "
         "value.</p>\n",
         fmi, version, UNIT_GUID);
  html_ports("Inputs", IS_INPUT);
  html_ports("States", IS_STATE);
  html_ports("Outputs", IS_OUTPUT);
  html_ports("Work at the ports", IS_INTEGRAL);
  for (int optional = 0; optional < 2; optional++) {
    printf("<h2>%s</h2>\n", optional ? "Terms that can be switched on" : "Base model");
    for (const TermInfo *t = TERM_INFO; t->name; t++) {
      if ((t->amplitude != NULL) != optional) continue;
      printf("<h3 id=\"%s\">%s: ", t->name, t->name);
      escaped(t->title);
      printf("</h3>\n<p><code>");
      escaped(t->equation);
      printf("</code><br>Source: ");
      escaped(t->source);
      printf("</p>\n<table>\n");
      html_rows(t->name, IS_PARAMETER);
      printf("</table>\n");
    }
  }
  printf("</body></html>\n");
  return 0;
}

#endif
