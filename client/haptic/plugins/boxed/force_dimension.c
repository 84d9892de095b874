/* Force Dimension's devices, through libdhd of the maker's SDK 3. What is declared here is what its published
 * interface says of these functions; nothing of the SDK is in this tree. Never tried with a device.
 *
 * The device's x is towards the operator, y to the right, z up, its origin amid the workspace; metres,
 * newtons. */
#define _GNU_SOURCE
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "box.h"

#define TURN_NS 500000
enum { STATUS_RESET = 3, STATUS_COUNT = 16 };

static int (*dhd_open)(void);
static int (*dhd_close)(char);
static int (*dhd_system_type)(char);
static const char* (*dhd_system_name)(char);
static int (*dhd_status)(int[STATUS_COUNT], char);
static int (*dhd_enable_force)(unsigned char, char);
static int (*dhd_position)(double*, double*, double*, char);
static int (*dhd_velocity)(double*, double*, double*, char);
static unsigned (*dhd_buttons)(char);
static int (*dhd_set_force)(double, double, double, char);
static const char* (*dhd_error)(void);

static char device_id;
static pthread_t thread;
static _Atomic int ends;

static const char* find(void* library) {
  const box_function functions[] = {{"dhdOpen", (void**)&dhd_open},
                                    {"dhdClose", (void**)&dhd_close},
                                    {"dhdGetSystemType", (void**)&dhd_system_type},
                                    {"dhdGetSystemName", (void**)&dhd_system_name},
                                    {"dhdGetStatus", (void**)&dhd_status},
                                    {"dhdEnableForce", (void**)&dhd_enable_force},
                                    {"dhdGetPosition", (void**)&dhd_position},
                                    {"dhdGetLinearVelocity", (void**)&dhd_velocity},
                                    {"dhdGetButtonMask", (void**)&dhd_buttons},
                                    {"dhdSetForce", (void**)&dhd_set_force},
                                    {"dhdErrorGetLastStr", (void**)&dhd_error},
                                    {NULL, NULL}};
  return box_find(library, functions);
}

static const char* last_error(void) {
  const char* text = dhd_error();
  return text != NULL ? text : "it says no more";
}

/* Largest force and workspace are the maker's data sheets'; how hard and how damped is our own caution, far
 * below what the maker states of the closed loop. A device that is not in the list is asked for little. */
static void state_limits(int type, teletact_device_limits* limits) {
  static const struct {
    int first, last;
    double force_n, radius_m;
  } families[] = {{32, 37, 12, 0.055},    /* omega */
                  {60, 60, 8, 0.05},      /* Falcon */
                  {61, 64, 20, 0.13},     /* delta */
                  {104, 107, 20, 0.065}}; /* sigma */
  limits->largest_force_n = 4;
  limits->largest_stiffness_n_m = 400;
  limits->largest_damping_n_s_m = 4;
  for (size_t k = 0; k < sizeof families / sizeof *families; ++k) {
    if (type < families[k].first || type > families[k].last) continue;
    limits->largest_force_n = families[k].force_n;
    limits->largest_stiffness_n_m = 1000;
    limits->largest_damping_n_s_m = 5;
    limits->workspace_radius_m = families[k].radius_m;
  }
}

static void turn(void) {
  double force_n[3], x = 0, y = 0, z = 0, vx = 0, vy = 0, vz = 0;
  box_force(force_n);
  /* Above 0: the same as before, or a motor at its limit: no errors. */
  if (dhd_set_force(-force_n[2], force_n[0], -force_n[1], device_id) < 0)
    return box_failed("dhdSetForce failed", last_error());
  if (dhd_position(&x, &y, &z, device_id) < 0) return box_failed("dhdGetPosition failed", last_error());
  /* Without a velocity the client derives it. */
  if (dhd_velocity(&vx, &vy, &vz, device_id) < 0) vx = vy = vz = 0;
  const double position_m[3] = {y, -z, -x}, velocity_m_s[3] = {vy, -vz, -vx};
  box_moved(position_m, velocity_m_s, dhd_buttons(device_id));
}

static void* run(void* unused) {
  (void)unused;
  struct sched_param priority = {.sched_priority = 40};
  pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority); /* where it is permitted */
  struct timespec pause = {0, TURN_NS};
  while (!ends) {
    turn();
    nanosleep(&pause, NULL);
  }
  return NULL;
}

static int give_up(const char* what, char* error) {
  snprintf(error, BOX_ERROR_BYTES, "%s: %.160s; see to its cable and power, and that no other program has it",
           what, last_error());
  return 1;
}

static int open_device(const box_settings* settings, char* name, size_t name_bytes,
                       teletact_device_limits* limits, char* error) {
  (void)settings;
  int status[STATUS_COUNT] = {0};
  const int id = dhd_open();
  if (id < 0) return give_up("no Force Dimension device", error);
  device_id = (char)id;
  const char* model = dhd_system_name(device_id);
  snprintf(name, name_bytes, "Force Dimension %s", model != NULL ? model : "device");
  state_limits(dhd_system_type(device_id), limits);
  if (dhd_status(status, device_id) < 0) {
    give_up("dhdGetStatus failed", error);
  } else if (status[STATUS_RESET] != 0) {
    snprintf(
        error, BOX_ERROR_BYTES,
        "the %s is not calibrated: put it where it rests, or run the maker's calibration, and start again",
        name);
  } else if (dhd_enable_force(1, device_id) < 0) {
    give_up("dhdEnableForce failed", error);
  } else {
    ends = 0;
    if (pthread_create(&thread, NULL, run, NULL) == 0) return 0;
    snprintf(error, BOX_ERROR_BYTES, "no thread for the device is to be had");
  }
  dhd_close(device_id);
  return 1;
}

static void close_device(void) {
  ends = 1;
  pthread_join(thread, NULL);
  dhd_set_force(0, 0, 0, device_id);
  dhd_enable_force(0, device_id);
  dhd_close(device_id);
}

const box_vendor box_force_dimension = {
    .name = "force-dimension",
    .product = "the Force Dimension SDK (libdhd)",
    .files = {"libdhd.so.3", "libdhd.so", NULL},
    .find = find,
    .open = open_device,
    .close = close_device,
};
