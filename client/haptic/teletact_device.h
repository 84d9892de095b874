/* The C interface between teletact and a haptic device that it does not know: what an adapter for a vendor's
 * SDK implements, as a shared library that `teletact-client touch --device plugin:FILE` loads.
 *
 * The library exports one function, teletact_device_plugin_get(). plugins/template.c is an adapter to start
 * from:
 *
 *     cc -shared -fPIC -I INCLUDE_DIR -o my_device.so my_device.c -lvendor
 *
 * Axes: x to the operator's right, y down (the direction that presses into the tissue), z away from the
 * operator: right-handed; metres, newtons, seconds. Any origin will do: where the device stands when it is
 * first read becomes the point above the tissue at which a session begins. In a plane scene the tissue is the
 * same for every z: the model's force along z is zero, and only damping of the safety chain acts there.
 *
 * Threads: open, close, show_taxels and trouble are called from one thread, read and write from another, the
 * servo's, 1000 times a second: these two may not wait, allocate, log or throw. A vendor's library that runs
 * a loop of its own leaves its newest position in memory for read() and takes the newest force from there.
 *
 * No hand is left with a force that nobody renews. The device holds the force of a write() until the next
 * one, but for 10 ms at most: then it lets go by itself, whatever keeps the client, a wait, Ctrl-Z, kill -9.
 * Where the vendor's controller does that, nothing is left to do. Where it does not, its SDK belongs into a
 * process of its own that outlives the client; template.c has one. */
#ifndef TELETACT_DEVICE_H
#define TELETACT_DEVICE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Raised by every change after which a library and a client of different versions cannot work together.
 * 2: limits.damping_n_s_m. 3: let_go. 4: z is passed on, away from the operator. 5: show_taxels. 6: the
 * reading's buttons, limits.workspace_centre_m, trouble. */
#define TELETACT_DEVICE_ABI 6u

/* What the device may be asked for. The first three must be > 0; 0 where the others are not known. */
typedef struct teletact_device_limits {
  double largest_force_n;
  double largest_stiffness_n_m;
  double largest_damping_n_s_m;
  double workspace_radius_m;
  double apparent_mass_kg;
  double friction_n; /* Coulomb friction that is surely there: the passivity controller counts on it */
  double resolution_m;
  double damping_n_s_m; /* viscous, of the mechanism, that is surely there: counted on as friction is */
  double workspace_centre_m[3]; /* of the ball of workspace_radius_m, in the axes of position_m */
} teletact_device_limits;

typedef struct teletact_device_reading {
  double position_m[3];   /* all zero before any other: the device has said nothing yet */
  double velocity_m_s[3]; /* all zero: not known, it is derived from the positions */
  int32_t resume_pressed; /* not 0: the button is down; the operator asks for force when it goes down */
  uint32_t buttons;       /* that are down: bit 0 is button 1; the operator names one of them as the clutch */
} teletact_device_reading;

/* What a tactile display shows: the pressure under the tip, on a grid of square taxels around its axis. */
typedef struct teletact_taxels {
  uint32_t along_x, along_z;
  double pitch_m;
  const float* pressure_pa; /* [z][x], into the tissue; this and the next are there until the call returns */
  const float* beyond_pa;   /* of it what is beyond homogeneous tissue at the same force; NULL: not known */
} teletact_taxels;

typedef struct teletact_device_plugin {
  uint32_t abi;          /* TELETACT_DEVICE_ABI */
  uint32_t struct_bytes; /* sizeof(teletact_device_plugin) */
  const char* name;      /* for people: "Vendor Model" */

  /* Opens the device; `settings` is what stands behind the comma of plugin:FILE,SETTINGS, or "".
   * Returns 0, with *device for the other calls and *limits filled in (it comes zeroed); else anything, with
   * one line in `error` that says what to do. */
  int (*open)(const char* settings, void** device, teletact_device_limits* limits, char* error,
              size_t error_bytes);

  /* The newest position and velocity; now_ns is CLOCK_MONOTONIC. Returns 0; anything else: the device does
   * not answer, and the servo takes the force away. */
  int (*read)(void* device, int64_t now_ns, teletact_device_reading* reading);

  /* Force on the operator's hand, never above largest_force_n. Returns 0; anything else: not taken. The
   * device holds it until the next call, and lets go when none came for 10 ms. */
  int (*write)(void* device, const double force_n[3]);

  /* Takes the force away and closes. Not called when a read or a write has not returned for 2 s: the client
   * then ends without it. */
  void (*close)(void* device);

  /* May be NULL. Takes the force away at once and for good: no write() comes after it. Called while the
   * process dies, in a signal handler and beside a write() that may be under way, up to twice: it must be
   * async-signal-safe, which rules out locks, memory, files and most of any SDK. Storing to shared memory,
   * or one write() to an open descriptor, is. */
  void (*let_go)(void* device);

  /* May be NULL. A new tactile image, at most 50 times a second, where the operator asks for them (touch
   * --tactile). It may not wait: a display that is slower takes the newest one from memory. */
  void (*show_taxels)(void* device, const teletact_taxels* taxels);

  /* May be NULL. What a person should know of the device by now, such as why it does not answer: one line in
   * `text`, and its length; 0 when there is nothing new. Asked for 50 times a second; it may not wait. */
  size_t (*trouble)(void* device, char* text, size_t text_bytes);
} teletact_device_plugin;

/* The one function that the library exports. What it returns lives as long as the library. */
const teletact_device_plugin* teletact_device_plugin_get(void);

#ifdef __cplusplus
}
#endif

#endif
