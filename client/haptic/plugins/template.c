/* An adapter to start from: everything teletact needs, around the four calls that a vendor's SDK offers.
 *
 * To make it yours, replace the part between the lines by your SDK's calls and give your device's data sheet
 * in adapter_open(). As it stands the "SDK" is a mass on a spring and a damper, hovering until the force of
 * write() pushes it, and what the tests load. Nobody presses its button: touch says that it waits for it.
 * With a press in its settings a hand holds the button and moves the spring down and up once in 4 s: enough
 * to see that the chain works (the tissue begins 5 mm below where the device is opened):
 *
 *   touch --device plugin:teletact_device_template.so,press=0.009 --duration-s 10 ...
 *
 * Settings, in this order: "stiffness=200" (N/m of that spring), "press=0.009" (m, how far it moves). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/haptic/teletact_device.h"

/* ---- the vendor's SDK: replace ------------------------------------------------------------------------ */

typedef struct vendor_device {
  double position_m[3], velocity_m_s[3], force_n[3];
  double stiffness_n_m, press_m;
  int64_t last_ns;
} vendor_device;

#define VENDOR_DAMPING_N_S_M 5.0
#define VENDOR_HOME_M (-0.1) /* where the device rests, from its own origin */

static vendor_device* vendor_connect(double stiffness_n_m, double press_m) {
  vendor_device* device = calloc(1, sizeof *device);
  if (device == NULL) return NULL;
  device->stiffness_n_m = stiffness_n_m;
  device->position_m[2] = VENDOR_HOME_M;
  device->press_m = press_m;
  return device;
}

static void vendor_disconnect(vendor_device* device) {
  free(device);
}

static void vendor_set_force(vendor_device* device, const double force_n[3]) {
  memcpy(device->force_n, force_n, sizeof device->force_n);
}

/* m dv/dt = F - k (x - x_hand) - b v, semi-implicit, in steps of 0.1 ms. */
static void vendor_update(vendor_device* device, int64_t now_ns) {
  const double mass_kg = 0.1, damping_n_s_m = VENDOR_DAMPING_N_S_M, step_s = 1e-4, longest_s = 0.1;
  double elapsed_s = device->last_ns == 0 ? 0 : 1e-9 * (double)(now_ns - device->last_ns);
  device->last_ns = now_ns;
  if (elapsed_s > longest_s) elapsed_s = longest_s;
  const double two_pi = 6.283185307179586, period_s = 4;
  const double hand_m[3] = {0, device->press_m * (1 - cos(two_pi / period_s * 1e-9 * (double)now_ns)) / 2,
                            VENDOR_HOME_M};
  for (; elapsed_s > step_s / 2; elapsed_s -= step_s) {
    for (int axis = 0; axis < 3; ++axis) {
      const double force_n = device->force_n[axis] -
                             device->stiffness_n_m * (device->position_m[axis] - hand_m[axis]) -
                             damping_n_s_m * device->velocity_m_s[axis];
      device->velocity_m_s[axis] += step_s / mass_kg * force_n;
      device->position_m[axis] += step_s * device->velocity_m_s[axis];
    }
  }
}

/* ------------------------------------------------------------------------------------------------------- */

static int adapter_open(const char* settings, void** device, teletact_device_limits* limits, char* error,
                        size_t error_bytes) {
  double stiffness_n_m = 200, press_m = 0;
  const int stiffness_given = sscanf(settings, "stiffness=%lf", &stiffness_n_m) == 1;
  const char* press = strstr(settings, "press=");
  const int press_given = press != NULL && sscanf(press, "press=%lf", &press_m) == 1;
  if ((settings[0] != '\0' && !stiffness_given && !press_given) || !(stiffness_n_m > 0) ||
      !(press_m >= 0 && press_m <= 0.05)) {
    snprintf(error, error_bytes, "settings '%s': give stiffness=N/m, above 0, or press=m, 0 to 0.05, or both",
             settings);
    return 1;
  }
  vendor_device* opened = vendor_connect(stiffness_n_m, press_m);
  if (opened == NULL) {
    snprintf(error, error_bytes, "the device cannot be reached: check its cable");
    return 1;
  }
  limits->largest_force_n = 3.3;
  limits->largest_stiffness_n_m = 400;
  limits->largest_damping_n_s_m = 4;
  limits->workspace_radius_m = 0.075;
  limits->damping_n_s_m = VENDOR_DAMPING_N_S_M;
  *device = opened;
  return 0;
}

static int adapter_read(void* device, int64_t now_ns, teletact_device_reading* reading) {
  vendor_device* vendor = device;
  vendor_update(vendor, now_ns);
  memcpy(reading->position_m, vendor->position_m, sizeof reading->position_m);
  memcpy(reading->velocity_m_s, vendor->velocity_m_s, sizeof reading->velocity_m_s);
  /* A button of yours: here it is pressed and released twice a second. */
  reading->resume_pressed = vendor->press_m > 0 && now_ns / 250000000 % 2 != 0;
  return 0;
}

static int adapter_write(void* device, const double force_n[3]) {
  vendor_set_force(device, force_n);
  return 0;
}

static void adapter_close(void* device) {
  const double none_n[3] = {0, 0, 0};
  vendor_set_force(device, none_n);
  vendor_disconnect(device);
}

const teletact_device_plugin* teletact_device_plugin_get(void) {
  static const teletact_device_plugin plugin = {
      .abi = TELETACT_DEVICE_ABI,
      .struct_bytes = sizeof(teletact_device_plugin),
      .name = "template",
      .open = adapter_open,
      .read = adapter_read,
      .write = adapter_write,
      .close = adapter_close,
  };
  return &plugin;
}
