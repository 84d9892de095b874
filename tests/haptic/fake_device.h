/* Between a test and a fake of a maker's library, in another process: a file that both map, named by the
 * environment. The fake's "hand" holds the device where the test says. */
#ifndef TELETACT_TESTS_FAKE_DEVICE_H
#define TELETACT_TESTS_FAKE_DEVICE_H

#include <stdint.h>

#ifdef __cplusplus
#include <atomic>
#define FAKE_SHARED(type) std::atomic<type>
#else
#include <stdatomic.h>
#define FAKE_SHARED(type) _Atomic type
#endif

#define FAKE_DEVICE_VARIABLE "TELETACT_FAKE_DEVICE"

enum {
  FAKE_WELL,
  FAKE_ABSENT,       /* it cannot be opened */
  FAKE_LOST,         /* every call fails */
  FAKE_REFUSES,      /* forces alone are refused */
  FAKE_SLOW,         /* reading the position takes slow_ms */
  FAKE_HANGS,        /* and never returns */
  FAKE_NO_NUMBER,    /* a position that is none */
  FAKE_JUMPS,        /* a position 0.2 m further on */
  FAKE_STUCK,        /* the position of before, whatever the hand does */
  FAKE_UNCALIBRATED, /* it waits for a person */
};

typedef struct fake_device {
  FAKE_SHARED(int32_t) mode;
  FAKE_SHARED(int32_t) slow_ms;
  FAKE_SHARED(double) position[3], velocity[3]; /* the maker's axes and units */
  FAKE_SHARED(double) force[3];                 /* that it was given last */
  FAKE_SHARED(int32_t) buttons;
  FAKE_SHARED(int64_t) turns; /* forces given */
  FAKE_SHARED(int32_t) opened, closed, force_enabled;
  FAKE_SHARED(int32_t) box; /* the process */
} fake_device;

#ifndef __cplusplus
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

static fake_device* fake_map(void) {
  static fake_device* mapped;
  if (mapped != NULL) return mapped;
  const char* name = getenv(FAKE_DEVICE_VARIABLE);
  const int descriptor = open(name != NULL ? name : "", O_RDWR | O_CLOEXEC);
  if (descriptor < 0) abort();
  mapped = mmap(NULL, sizeof *mapped, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  close(descriptor);
  mapped->box = getpid();
  return mapped;
}

static void fake_pause_ms(long ms) {
  const struct timespec pause = {ms / 1000, ms % 1000 * 1000000};
  nanosleep(&pause, NULL);
}

/* The position as its mode has it, `jump` further on; false: the call fails. */
static int fake_position(double out[3], double jump) {
  static double before[3];
  fake_device* fake = fake_map();
  const int mode = fake->mode;
  if (mode == FAKE_LOST) return 0;
  if (mode == FAKE_SLOW) fake_pause_ms(fake->slow_ms);
  while (fake->mode == FAKE_HANGS) fake_pause_ms(10);
  for (int axis = 0; axis < 3; ++axis) {
    if (mode != FAKE_STUCK) before[axis] = fake->position[axis];
    out[axis] = before[axis];
    if (mode == FAKE_NO_NUMBER) out[axis] = NAN;
    if (mode == FAKE_JUMPS) out[axis] += jump;
  }
  return 1;
}

static void fake_take_force(double x, double y, double z) {
  fake_device* fake = fake_map();
  fake->force[0] = x, fake->force[1] = y, fake->force[2] = z;
  ++fake->turns;
}
#endif

#endif
