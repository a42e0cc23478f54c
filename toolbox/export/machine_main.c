/* Runs the machine of @NAME@.h and prints its switches, then its outputs at the end: @NAME@ [duration [period]] */
#include <stdio.h>
#include <stdlib.h>

#include "@NAME@.h"

int main(int count, char **words) {
  static @NAME@_machine machine; /* large ones do not fit a small stack */
  double duration = count > 1 ? atof(words[1]) : @DURATION@;
  double period = count > 2 ? atof(words[2]) : duration;
  double y[@UPPER@_OUTPUTS];
  int i, element, before, after, status = @UPPER@_DONE;
  long k;
  @NAME@_start(&machine);
  for (k = 1; status == @UPPER@_DONE && @NAME@_time(&machine) < duration; ++k) {
    double until = k * period < duration ? k * period : duration;
    do {
      status = @NAME@_step(&machine, until);
      for (i = 0; i < @NAME@_events(&machine); ++i) {
        double t = @NAME@_event(&machine, i, &element, &before, &after);
        printf("%.17g %s %s %s\n", t, @NAME@_element_name(element), @NAME@_mode_name(element, before), @NAME@_mode_name(element, after));
      }
    } while (status == @UPPER@_OVERRUN);
  }
  if (status != @UPPER@_DONE) {
    const char *where = @NAME@_culprit_name(&machine, status);
    fprintf(stderr, "%s stopped at %.9g s: %s\n", where ? where : "machine", @NAME@_time(&machine), @NAME@_status_text(status));
  }
  @NAME@_outputs(&machine, y);
  for (i = 0; i < @UPPER@_OUTPUTS; ++i) printf("# %s = %.17g\n", @NAME@_output_name(i), y[i]);
  return status;
}
