/* Adapters with one fault each, chosen by a definition: OLD_ABI, NO_LIMITS, BAD_DAMPING, NO_SYMBOL;
 * SLOW_START has no position at first, then one that is no number, and never a velocity; BLOCKS does not
 * return from the read whose number its settings say, and tells stderr that it has been let go of; SILENT
 * has no other fault than that it never has a position. */
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#include "client/haptic/teletact_device.h"

static int blocked_read; /* none: 0 */

static int open_it(const char* settings, void** device, teletact_device_limits* limits, char* error,
                   size_t error_bytes) {
  (void)error, (void)error_bytes;
  blocked_read = atoi(settings);
  static int something;
  *device = &something;
#ifndef NO_LIMITS
  limits->largest_force_n = limits->largest_stiffness_n_m = limits->largest_damping_n_s_m = 1;
#else
  (void)limits;
#endif
#ifdef BLOCKS
  limits->largest_stiffness_n_m = 400;
#endif
#ifdef BAD_DAMPING
  limits->damping_n_s_m = -1;
#endif
  return 0;
}
static int read_it(void* device, int64_t now_ns, teletact_device_reading* reading) {
  (void)device, (void)now_ns, (void)reading;
#ifdef BLOCKS
  static int count;
  reading->position_m[0] = 0.1;
  if (++count == blocked_read) {
    (void)!write(STDERR_FILENO, "blocked\n", 8);
    for (;;) pause();
  }
#endif
#ifdef SLOW_START
  static int reads;
  ++reads;
  if (reads > 5) reading->position_m[0] = 0.1;
  if (reads > 5) reading->position_m[1] = reads == 6 ? (double)NAN : 1e-4 * reads;
#endif
  return 0;
}
static int write_it(void* device, const double force_n[3]) {
  (void)device, (void)force_n;
  return 0;
}
static void close_it(void* device) {
  (void)device;
}
static void let_go_of_it(void* device) {
  (void)device;
#ifdef BLOCKS
  (void)!write(STDERR_FILENO, "let go\n", 7);
#endif
}

#ifdef OLD_ABI
#define ABI (TELETACT_DEVICE_ABI + 7u)
#else
#define ABI TELETACT_DEVICE_ABI
#endif

#ifdef NO_SYMBOL
const teletact_device_plugin* another_name(void);
const teletact_device_plugin* another_name(void) {
#else
const teletact_device_plugin* teletact_device_plugin_get(void) {
#endif
  static const teletact_device_plugin plugin = {
      ABI, sizeof(teletact_device_plugin), "faulty", open_it, read_it, write_it, close_it, let_go_of_it, NULL,
      NULL};
  return &plugin;
}
