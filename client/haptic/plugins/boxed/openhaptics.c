/* Touch, Omni and Phantom devices, through libHD of OpenHaptics 3. What is declared here is what its
 * published interface says of these functions; nothing of OpenHaptics is in this tree. Never tried with a
 * device.
 *
 * The device's x is to the right, y up, z towards the operator; millimetres, newtons. A callback that the
 * library calls 1000 times a second is the turn. */
#define _GNU_SOURCE
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "box.h"

typedef struct hd_error_info {
  unsigned code;
  int internal_code;
  unsigned device;
} hd_error_info;
typedef unsigned (*hd_callback)(void*);

enum {
  HD_CURRENT_BUTTONS = 0x2000,
  HD_CURRENT_POSITION = 0x2050,
  HD_CURRENT_VELOCITY = 0x2051,
  HD_DEVICE_MODEL_TYPE = 0x2501,
  HD_USABLE_WORKSPACE_DIMENSIONS = 0x2551,
  HD_NOMINAL_MAX_STIFFNESS = 0x2602,
  HD_NOMINAL_MAX_FORCE = 0x2603,
  HD_NOMINAL_MAX_DAMPING = 0x2609,
  HD_CURRENT_FORCE = 0x2700,
  HD_FORCE_OUTPUT = 0x4000,
  HD_CALIBRATION_OK = 0x5000,
  HD_CALIBRATION_NEEDS_UPDATE = 0x5001,
  HD_CALLBACK_CONTINUE = 1,
  HD_DEFAULT_SCHEDULER_PRIORITY = 0xffff / 2
};
#define HD_INVALID_HANDLE 0xffffffffu

static unsigned (*hd_init)(const char*);
static void (*hd_disable_device)(unsigned);
static void (*hd_enable)(unsigned);
static void (*hd_disable)(unsigned);
static void (*hd_start)(void);
static void (*hd_stop)(void);
static unsigned long (*hd_schedule)(hd_callback, void*, unsigned short);
static void (*hd_unschedule)(unsigned long);
static void (*hd_begin_frame)(unsigned);
static void (*hd_end_frame)(unsigned);
static void (*hd_get_doubles)(unsigned, double*);
static void (*hd_get_integers)(unsigned, int*);
static void (*hd_set_doubles)(unsigned, const double*);
static const char* (*hd_get_string)(unsigned);
static hd_error_info (*hd_error)(void);
static const char* (*hd_error_string)(unsigned);
static unsigned (*hd_check_calibration)(void);
static unsigned (*hd_calibration_style)(void);
static void (*hd_update_calibration)(unsigned);

static unsigned device = HD_INVALID_HANDLE;
static unsigned long callback;
static int calibrated;

static const char* find(void* library) {
  const box_function functions[] = {{"hdInitDevice", (void**)&hd_init},
                                    {"hdDisableDevice", (void**)&hd_disable_device},
                                    {"hdEnable", (void**)&hd_enable},
                                    {"hdDisable", (void**)&hd_disable},
                                    {"hdStartScheduler", (void**)&hd_start},
                                    {"hdStopScheduler", (void**)&hd_stop},
                                    {"hdScheduleAsynchronous", (void**)&hd_schedule},
                                    {"hdUnschedule", (void**)&hd_unschedule},
                                    {"hdBeginFrame", (void**)&hd_begin_frame},
                                    {"hdEndFrame", (void**)&hd_end_frame},
                                    {"hdGetDoublev", (void**)&hd_get_doubles},
                                    {"hdGetIntegerv", (void**)&hd_get_integers},
                                    {"hdSetDoublev", (void**)&hd_set_doubles},
                                    {"hdGetString", (void**)&hd_get_string},
                                    {"hdGetError", (void**)&hd_error},
                                    {"hdGetErrorString", (void**)&hd_error_string},
                                    {"hdCheckCalibration", (void**)&hd_check_calibration},
                                    {"hdCheckCalibrationStyle", (void**)&hd_calibration_style},
                                    {"hdUpdateCalibration", (void**)&hd_update_calibration},
                                    {NULL, NULL}};
  return box_find(library, functions);
}

/* Empties the library's stack of errors; false when there was none. `text`: of the newest. */
static int has_failed(char* text, size_t bytes) {
  int failed = 0;
  for (int most = 64; most > 0; --most) {
    const hd_error_info error = hd_error();
    if (error.code == 0) break;
    if (failed++) continue;
    const char* said = hd_error_string(error.code);
    snprintf(text, bytes, "%.120s (0x%04x)", said != NULL ? said : "it says no more", error.code);
  }
  return failed > 0;
}

static unsigned turn(void* unused) {
  (void)unused;
  char error[160];
  double force_n[3], mm[3] = {0, 0, 0}, mm_s[3] = {0, 0, 0};
  int buttons = 0;
  hd_begin_frame(device);
  if (!calibrated) {
    const unsigned state = hd_check_calibration();
    if (state == HD_CALIBRATION_NEEDS_UPDATE) hd_update_calibration(hd_calibration_style());
    calibrated = state == HD_CALIBRATION_OK;
  }
  hd_get_doubles(HD_CURRENT_POSITION, mm);
  hd_get_doubles(HD_CURRENT_VELOCITY, mm_s);
  hd_get_integers(HD_CURRENT_BUTTONS, &buttons);
  box_force(force_n);
  const double device_n[3] = {force_n[0], -force_n[1], -force_n[2]};
  hd_set_doubles(HD_CURRENT_FORCE, device_n);
  hd_end_frame(device);
  const double position_m[3] = {1e-3 * mm[0], -1e-3 * mm[1], -1e-3 * mm[2]};
  const double velocity_m_s[3] = {1e-3 * mm_s[0], -1e-3 * mm_s[1], -1e-3 * mm_s[2]};
  if (has_failed(error, sizeof error))
    box_failed("OpenHaptics reports an error", error);
  else if (!calibrated)
    box_waits("calibrate it: put the stylus into its inkwell, or run the maker's set-up tool");
  else
    box_moved(position_m, velocity_m_s, (unsigned)buttons);
  return HD_CALLBACK_CONTINUE;
}

/* As the library states them, within what we dare; where it states none, our own caution. */
static double stated(unsigned what, double unit, double otherwise, double most) {
  double value = 0;
  hd_get_doubles(what, &value);
  value *= unit;
  return value > 0 && isfinite(value) ? fmin(value, most) : otherwise;
}

static void state_limits(teletact_device_limits* limits) {
  double box_mm[6] = {0, 0, 0, 0, 0, 0};
  limits->largest_force_n = stated(HD_NOMINAL_MAX_FORCE, 1, 3, 40);
  limits->largest_stiffness_n_m = stated(HD_NOMINAL_MAX_STIFFNESS, 1e3, 400, 1000); /* N/mm */
  limits->largest_damping_n_s_m = stated(HD_NOMINAL_MAX_DAMPING, 1e3, 2, 5);        /* N/(mm/s) */
  hd_get_doubles(HD_USABLE_WORKSPACE_DIMENSIONS, box_mm);                           /* least, largest */
  double half_mm = INFINITY;
  for (int axis = 0; axis < 3; ++axis) half_mm = fmin(half_mm, (box_mm[axis + 3] - box_mm[axis]) / 2);
  if (!(half_mm > 0) || !isfinite(half_mm)) return;
  limits->workspace_radius_m = 1e-3 * half_mm;
  for (int axis = 0; axis < 3; ++axis)
    limits->workspace_centre_m[axis] = (axis == 0 ? 1e-3 : -1e-3) * (box_mm[axis] + box_mm[axis + 3]) / 2;
}

static void close_device(void) {
  hd_stop();
  hd_unschedule(callback);
  hd_disable(HD_FORCE_OUTPUT);
  hd_disable_device(device);
}

static int open_device(const box_settings* settings, char* name, size_t name_bytes,
                       teletact_device_limits* limits, char* error) {
  char why[160] = "it says no more";
  device = hd_init(settings->device[0] != '\0' ? settings->device : NULL);
  if (has_failed(why, sizeof why) || device == HD_INVALID_HANDLE) {
    snprintf(error, BOX_ERROR_BYTES,
             "no device of OpenHaptics%s%s: %s; see to its cable and power and that no other program has it, "
             "and run "
             "the maker's set-up tool",
             settings->device[0] ? " with the name " : "", settings->device, why);
    return 1;
  }
  const char* model = hd_get_string(HD_DEVICE_MODEL_TYPE);
  snprintf(name, name_bytes, "OpenHaptics %s", model != NULL ? model : "device");
  hd_enable(HD_FORCE_OUTPUT);
  state_limits(limits);
  has_failed(why, sizeof why); /* of what this model does not state */
  calibrated = 0;
  callback = hd_schedule(turn, NULL, HD_DEFAULT_SCHEDULER_PRIORITY);
  hd_start();
  return 0;
}

const box_vendor box_openhaptics = {
    .name = "openhaptics",
    .product = "OpenHaptics (libHD) and the device's driver",
    .files = {"libHD.so", "libHD.so.3.4", "libHD.so.3.0", NULL},
    .takes_device_name = 1,
    .find = find,
    .open = open_device,
    .close = close_device,
};
