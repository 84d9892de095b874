/* What the adapter uses of libHD, told what to do by fake_device.h. */
#include <pthread.h>
#include <string.h>

#include "tests/haptic/fake_device.h"

#define API __attribute__((visibility("default")))

typedef struct {
  unsigned code;
  int internal_code;
  unsigned device;
} error_info;
typedef unsigned (*scheduled)(void*);

static _Atomic unsigned error_code; /* a stack of one */
static _Atomic int running;
static pthread_t scheduler;
static scheduled callback;
static void* callback_data;
static double frame_force[3];

static void* schedule(void* unused) {
  (void)unused;
  while (running) {
    if (callback != NULL && callback(callback_data) != 1) callback = NULL;
    fake_pause_ms(1);
  }
  return NULL;
}

API unsigned hdInitDevice(const char* name) {
  fake_device* fake = fake_map();
  const int known = name == NULL || strcmp(name, "Left Device") == 0;
  if (fake->mode == FAKE_ABSENT || fake->mode == FAKE_LOST || !known) {
    error_code = 0x0304;
    return 0xffffffffu;
  }
  ++fake->opened;
  return 0;
}
API void hdDisableDevice(unsigned device) {
  (void)device;
  ++fake_map()->closed;
}
API void hdEnable(unsigned what) {
  if (what == 0x4000) fake_map()->force_enabled = 1;
}
API void hdDisable(unsigned what) {
  if (what == 0x4000) fake_map()->force_enabled = 0;
}
API void hdStartScheduler(void) {
  running = 1;
  pthread_create(&scheduler, NULL, schedule, NULL);
}
API void hdStopScheduler(void) {
  running = 0;
  pthread_join(scheduler, NULL);
}
API unsigned long hdScheduleAsynchronous(scheduled what, void* data, unsigned short priority) {
  (void)priority;
  callback_data = data;
  callback = what;
  return 7;
}
API void hdUnschedule(unsigned long handle) {
  if (handle == 7) callback = NULL;
}
API void hdBeginFrame(unsigned device) {
  (void)device;
  frame_force[0] = frame_force[1] = frame_force[2] = 0;
}
API void hdEndFrame(unsigned device) {
  (void)device;
  const int mode = fake_map()->mode;
  if (mode == FAKE_LOST) error_code = 0x0302;
  if (mode == FAKE_REFUSES) error_code = 0x0200;
  if (mode != FAKE_LOST && mode != FAKE_REFUSES)
    fake_take_force(frame_force[0], frame_force[1], frame_force[2]);
}
API void hdGetDoublev(unsigned what, double* out) {
  const fake_device* fake = fake_map();
  if (what == 0x2050 && !fake_position(out, 200)) error_code = 0x0302;
  if (what == 0x2051)
    for (int axis = 0; axis < 3; ++axis) out[axis] = fake->velocity[axis];
  if (what == 0x2602) *out = 0.5;   /* N/mm */
  if (what == 0x2603) *out = 3.3;   /* N */
  if (what == 0x2609) *out = 0.003; /* N/(mm/s) */
  if (what == 0x2551) {
    const double box_mm[6] = {-80, -60, -35, 80, 60, 35};
    memcpy(out, box_mm, sizeof box_mm);
  }
}
API void hdGetIntegerv(unsigned what, int* out) {
  if (what == 0x2000) *out = fake_map()->buttons;
}
API void hdSetDoublev(unsigned what, const double* in) {
  if (what == 0x2700) memcpy(frame_force, in, sizeof frame_force);
}
API const char* hdGetString(unsigned what) {
  return what == 0x2501 ? "Touch" : "";
}
API error_info hdGetError(void) {
  const error_info error = {error_code, 0, 0};
  error_code = 0;
  return error;
}
API const char* hdGetErrorString(unsigned code) {
  return code == 0x0200 ? "warm motors" : code == 0x0302 ? "communication error" : "timer error";
}
API unsigned hdCheckCalibration(void) {
  return fake_map()->mode == FAKE_UNCALIBRATED ? 0x5002 : 0x5000;
}
#ifndef LACKS_A_FUNCTION
API unsigned hdCheckCalibrationStyle(void) {
  return 4;
}
#endif
API void hdUpdateCalibration(unsigned style) {
  (void)style;
}
