/* The page of memory between an adapter, in the client, and the box, the process that has the maker's
 * library. Neither waits for the other: the newest force goes one way, the newest state the other. The three
 * axes of one vector may be of two turns of the box, a fraction of a millisecond apart. Times are
 * CLOCK_MONOTONIC. */
#ifndef TELETACT_BOXED_PAGE_H
#define TELETACT_BOXED_PAGE_H

#include <stdatomic.h>
#include <stdint.h>
#include <sys/types.h>
#include <time.h>

#include "teletact_device.h"

#define BOX_PAGE_DESCRIPTOR 3       /* of the box, at its start */
#define BOX_FORCE_LIVES_NS 10000000 /* without a new one */
#define BOX_SLOW_NS 10000000        /* a turn that took longer is said */
#define BOX_IS_LOST_NS 100000000    /* without a turn: the adapter's read() says so */
#define BOX_HANGS_NS 250000000      /* the same: the box ends itself */
#define BOX_FAILS_NS 500000000      /* of turns that failed: the device is opened anew */
#define BOX_NS_PER_S 1000000000

enum { BOX_OPENING = 0, BOX_OPEN = 1, BOX_REFUSED = 2 };

typedef struct box_page {
  pid_t client;
  _Atomic int32_t state;
  char name[96];   /* "Force Dimension omega.3"; this and the next two are whole once the state says so */
  char error[480]; /* of BOX_REFUSED */
  teletact_device_limits limits;

  _Atomic int64_t closed, let_go; /* the client's orders */
  _Atomic double command_n[3];
  _Atomic int64_t commanded_ns; /* 0: never */

  _Atomic double position_m[3], velocity_m_s[3]; /* the client's axes */
  _Atomic uint32_t buttons;
  _Atomic int64_t moved_ns;
  _Atomic int64_t failures; /* turns that failed, so far */

  _Atomic uint32_t said; /* troubles, so far; the newest is trouble[said % 2] */
  char trouble[2][224];
} box_page;

static inline int64_t box_now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * BOX_NS_PER_S + now.tv_nsec;
}

#endif
