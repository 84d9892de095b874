/* What a maker's library is to the box, and the box to it. */
#ifndef TELETACT_BOXED_BOX_H
#define TELETACT_BOXED_BOX_H

#include <stddef.h>
#include <stdint.h>

#include "teletact_device.h"

#define BOX_ERROR_BYTES 480

typedef struct box_settings {
  char library[256]; /* library=PATH; empty: where the loader looks */
  char device[64];   /* device=NAME; empty: the first */
} box_settings;

typedef struct box_vendor {
  const char* name;     /* as adapters call it */
  const char* product;  /* for people: what is to be installed */
  const char* files[4]; /* names of its library, the likeliest first */
  int takes_device_name;
  /* Finds its functions. Returns 0, or else what is missing. */
  const char* (*find)(void* library);
  /* Opens the device and begins turns, on a thread of its own. Returns 0 with name and limits filled in, else
   * why not in `error`. */
  int (*open)(const box_settings* settings, char* name, size_t name_bytes, teletact_device_limits* limits,
              char* error);
  /* Ends the turns, leaves no force, closes. */
  void (*close)(void);
} box_vendor;

extern const box_vendor box_force_dimension, box_openhaptics;

/* A named function of a library. */
typedef struct box_function {
  const char* name;
  void** at;
} box_function;
/* Finds all of a list that ends with a NULL name. Returns the first that is missing, or NULL. */
const char* box_find(void* library, const box_function* functions);

/* A turn, some 1000 a second on the vendor's thread: asks what force to give now, in the client's axes (x
 * right, y down, z away), and tells one of the three. */
void box_force(double force_n[3]);
void box_moved(const double position_m[3], const double velocity_m_s[3], uint32_t buttons);
void box_failed(const char* what, const char* why);
void box_waits(const char* why); /* it answers, but has no position yet */

#endif
