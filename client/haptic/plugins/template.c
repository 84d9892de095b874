/* An adapter to start from: everything teletact needs, around the few calls that a vendor's SDK offers.
 *
 * The SDK runs in a process of its own, the box, that shares one page of memory with the adapter. So read()
 * and write() never wait for it; and the force ends with the client, whatever ends that: when no write()
 * came for 10 ms the box lets go. To make it yours, replace the part between the lines by your SDK's calls
 * and give your device's data sheet in adapter_open(). (The box is forked from a process with threads. glibc
 * keeps malloc usable there; an SDK that needs more is started with exec.)
 *
 * As it stands the "SDK" is a mass on a spring and a damper, hovering until the force of write() pushes it,
 * and what the tests load. Its button is never pressed, so touch waits for it. With a press in its
 * settings a hand holds the button and moves the spring down and up once in 4 s: enough to see that the chain
 * works (the tissue begins 5 mm below where the device is opened):
 *
 *   touch --device plugin:teletact_device_template.so,press=0.009 --duration-s 10 ...
 *
 * Settings, in this order: "stiffness=200" (N/m of that spring), "press=0.009" (m, how far it moves),
 * "period=4" (s, once down and up), "page=FILE" (puts the shared page into this file, so that you can look
 * at it: struct page below). */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "teletact_device.h"

#define FORCE_LIVES_NS 10000000 /* without a new write() */
#define BOX_PERIOD_NS 500000
#define BOX_IS_LOST_NS 500000000
#define NS_PER_S 1000000000

/* Between the adapter and the box. Forces of three axes may be read from two writes: of no harm. */
typedef struct page {
  _Atomic double motor_n[3]; /* what the motors give now */
  _Atomic int64_t lapses;    /* times that the box let go because no force came */
  _Atomic int64_t let_go;    /* calls of let_go() */
  _Atomic int64_t closed;
  _Atomic double command_n[3];
  _Atomic int64_t commanded_ns; /* CLOCK_MONOTONIC, as the others; 0: never */
  _Atomic double position_m[3], velocity_m_s[3];
  _Atomic int64_t moved_ns;
  _Atomic int64_t images;  /* tactile images shown */
  _Atomic double shown_pa; /* the largest pressure of the newest */
} page;

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * NS_PER_S + now.tv_nsec;
}

/* ---- the vendor's SDK: replace ------------------------------------------------------------------------ */

typedef struct vendor_device {
  double position_m[3], velocity_m_s[3], force_n[3];
  double stiffness_n_m, press_m, period_s;
  int64_t last_ns, hand_moves_ns; /* the latter 0: not yet */
} vendor_device;

#define VENDOR_DAMPING_N_S_M 5.0
#define VENDOR_HOME_M (-0.1) /* where the device rests, from its own origin */

static void vendor_connect(vendor_device* device, double stiffness_n_m, double press_m, double period_s) {
  memset(device, 0, sizeof *device);
  device->stiffness_n_m = stiffness_n_m;
  device->position_m[2] = VENDOR_HOME_M;
  device->press_m = press_m;
  device->period_s = period_s;
}

static void vendor_set_force(vendor_device* device, const double force_n[3]) {
  memcpy(device->force_n, force_n, sizeof device->force_n);
}

/* m dv/dt = F - k (x - x_hand) - b v, semi-implicit, in steps of 0.1 ms. */
static void vendor_update(vendor_device* device, int64_t time_ns) {
  const double mass_kg = 0.1, damping_n_s_m = VENDOR_DAMPING_N_S_M, step_s = 1e-4, longest_s = 0.1;
  double elapsed_s = device->last_ns == 0 ? 0 : 1e-9 * (double)(time_ns - device->last_ns);
  device->last_ns = time_ns;
  if (elapsed_s > longest_s) elapsed_s = longest_s;
  const double two_pi = 6.283185307179586;
  const double moves_s = device->hand_moves_ns == 0 ? 0 : 1e-9 * (double)(time_ns - device->hand_moves_ns);
  const double hand_m[3] = {0, device->press_m * (1 - cos(two_pi / device->period_s * moves_s)) / 2,
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

/* ---- the box: the process that has the device ---------------------------------------------------------- */

static void give_force(page* shared, vendor_device* vendor, const double force_n[3]) {
  vendor_set_force(vendor, force_n);
  for (int axis = 0; axis < 3; ++axis) shared->motor_n[axis] = force_n[axis];
}

static void show_state(page* shared, const vendor_device* vendor, int64_t time_ns) {
  for (int axis = 0; axis < 3; ++axis) {
    shared->position_m[axis] = vendor->position_m[axis];
    shared->velocity_m_s[axis] = vendor->velocity_m_s[axis];
  }
  shared->moved_ns = time_ns;
}

static void run_box(page* shared, vendor_device* vendor, pid_t client) {
  const struct timespec period = {0, BOX_PERIOD_NS};
  const double none_n[3] = {0, 0, 0};
  int lives = 0;
  while (!shared->closed && getppid() == client) {
    const int lived = lives;
    const int64_t time_ns = now_ns();
    lives = !shared->let_go && time_ns - shared->commanded_ns < FORCE_LIVES_NS;
    const double force_n[3] = {shared->command_n[0], shared->command_n[1], shared->command_n[2]};
    give_force(shared, vendor, lives ? force_n : none_n);
    if (vendor->hand_moves_ns == 0) vendor->hand_moves_ns = shared->commanded_ns; /* from where it stood */
    if (lived && !lives && !shared->let_go) ++shared->lapses;
    vendor_update(vendor, time_ns);
    show_state(shared, vendor, time_ns);
    nanosleep(&period, NULL);
  }
  give_force(shared, vendor, none_n);
}

/* ---- the adapter --------------------------------------------------------------------------------------- */

typedef struct adapter {
  page* shared;
  pid_t box;
  int button;
} adapter;

/* NULL when there is none to be had. */
static page* map_page(const char* file) {
  int descriptor = -1;
  if (file[0] != '\0') {
    descriptor = open(file, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (descriptor < 0 || ftruncate(descriptor, sizeof(page)) != 0) return NULL;
  }
  void* mapped = mmap(NULL, sizeof(page), PROT_READ | PROT_WRITE,
                      MAP_SHARED | (descriptor < 0 ? MAP_ANONYMOUS : 0), descriptor, 0);
  if (descriptor >= 0) close(descriptor);
  return mapped == MAP_FAILED ? NULL : memset(mapped, 0, sizeof(page));
}

/* False when there is no process to be had. */
static int start_box(adapter* opened, vendor_device* vendor) {
  const pid_t client = getpid();
  show_state(opened->shared, vendor, now_ns()); /* from the first read() on */
  opened->box = fork();
  if (opened->box != 0) return opened->box > 0;
  setsid();               /* the terminal's signals are the client's */
  close_range(0, ~0u, 0); /* so are its connections */
  run_box(opened->shared, vendor, client);
  _exit(0);
}

static int adapter_open(const char* settings, void** device, teletact_device_limits* limits, char* error,
                        size_t error_bytes) {
  double stiffness_n_m = 200, press_m = 0, period_s = 4;
  char file[256] = "";
  const int stiffness_given = sscanf(settings, "stiffness=%lf", &stiffness_n_m) == 1;
  const char* press = strstr(settings, "press=");
  const int press_given = press != NULL && sscanf(press, "press=%lf", &press_m) == 1;
  const char* period = strstr(settings, "period=");
  const int period_given = period != NULL && sscanf(period, "period=%lf", &period_s) == 1;
  const char* page_at = strstr(settings, "page=");
  const int page_given = page_at != NULL && sscanf(page_at, "page=%255s", file) == 1;
  if ((settings[0] != '\0' && !stiffness_given && !press_given && !period_given && !page_given) ||
      !(stiffness_n_m > 0) || !(press_m >= 0 && press_m <= 0.05) || !(period_s >= 0.5 && period_s <= 60)) {
    snprintf(error, error_bytes,
             "settings '%s': give stiffness=N/m, above 0, or press=m, 0 to 0.05, or period=s, 0.5 to 60, or "
             "page=FILE, "
             "or several",
             settings);
    return 1;
  }
  adapter* opened = calloc(1, sizeof *opened);
  page* shared = map_page(file);
  if (opened == NULL || shared == NULL) {
    snprintf(error, error_bytes, "no memory to share with the device's process%s%s", file[0] ? " in " : "",
             file);
    if (shared != NULL) munmap(shared, sizeof *shared);
    free(opened);
    return 1;
  }
  opened->shared = shared;
  opened->button = press_m > 0;
  vendor_device vendor;
  vendor_connect(&vendor, stiffness_n_m, press_m, period_s);
  if (!start_box(opened, &vendor)) {
    snprintf(error, error_bytes, "the device cannot be reached: check its cable");
    munmap(shared, sizeof *shared);
    free(opened);
    return 1;
  }
  limits->largest_force_n = 3.3;
  limits->largest_stiffness_n_m = 400;
  limits->largest_damping_n_s_m = 4;
  limits->workspace_radius_m = 0.075;
  limits->workspace_centre_m[2] = VENDOR_HOME_M;
  limits->damping_n_s_m = VENDOR_DAMPING_N_S_M;
  *device = opened;
  return 0;
}

static int adapter_read(void* device, int64_t time_ns, teletact_device_reading* reading) {
  const adapter* opened = device;
  for (int axis = 0; axis < 3; ++axis) {
    reading->position_m[axis] = opened->shared->position_m[axis];
    reading->velocity_m_s[axis] = opened->shared->velocity_m_s[axis];
  }
  /* A button of yours: here it is pressed and released twice a second. */
  reading->resume_pressed = opened->button && time_ns / 250000000 % 2 != 0;
  reading->buttons = reading->resume_pressed ? 1u : 0u; /* yours may have more: bit 1 is button 2 */
  return now_ns() - opened->shared->moved_ns > BOX_IS_LOST_NS;
}

static int adapter_write(void* device, const double force_n[3]) {
  page* shared = ((adapter*)device)->shared;
  for (int axis = 0; axis < 3; ++axis) shared->command_n[axis] = force_n[axis];
  shared->commanded_ns = now_ns();
  return 0;
}

/* No display is here: yours sets its pins or cells, or leaves the image to the process that does. */
static void adapter_show_taxels(void* device, const teletact_taxels* taxels) {
  page* shared = ((adapter*)device)->shared;
  float largest_pa = 0;
  for (uint32_t k = 0; k < taxels->along_x * taxels->along_z; ++k)
    if (taxels->pressure_pa[k] > largest_pa) largest_pa = taxels->pressure_pa[k];
  shared->shown_pa = largest_pa;
  ++shared->images;
}

static void adapter_let_go(void* device) {
  ++((adapter*)device)->shared->let_go;
}

static void adapter_close(void* device) {
  adapter* opened = device;
  opened->shared->closed = 1;
  waitpid(opened->box, NULL, 0); /* the force is gone then */
  munmap(opened->shared, sizeof *opened->shared);
  free(opened);
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
      .let_go = adapter_let_go,
      .show_taxels = adapter_show_taxels,
      .trouble = NULL, /* yours says why the SDK does not answer */
  };
  return &plugin;
}
