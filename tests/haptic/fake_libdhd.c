/* What the adapter uses of libdhd, told what to do by fake_device.h. */
#include "tests/haptic/fake_device.h"

#define API __attribute__((visibility("default")))

API int dhdOpen(void) {
  fake_device* fake = fake_map();
  if (fake->mode == FAKE_ABSENT || fake->mode == FAKE_LOST) return -1;
  ++fake->opened;
  return 0;
}
API int dhdClose(char id) {
  (void)id;
  ++fake_map()->closed;
  return 0;
}
API int dhdGetSystemType(char id) {
  (void)id;
  return 33;
}
API const char* dhdGetSystemName(char id) {
  (void)id;
  return "omega.3";
}
API int dhdGetStatus(int status[16], char id) {
  (void)id;
  for (int k = 0; k < 16; ++k) status[k] = 0;
  status[3] = fake_map()->mode == FAKE_UNCALIBRATED;
  return 0;
}
API int dhdEnableForce(unsigned char on, char id) {
  (void)id;
  fake_map()->force_enabled = on;
  return 0;
}
API int dhdGetPosition(double* x, double* y, double* z, char id) {
  (void)id;
  double p[3];
  if (!fake_position(p, 0.2)) return -1;
  *x = p[0], *y = p[1], *z = p[2];
  return 1; /* the same as before, as it says when it is asked often: no error */
}
API int dhdGetLinearVelocity(double* x, double* y, double* z, char id) {
  (void)id;
  fake_device* fake = fake_map();
  *x = fake->velocity[0], *y = fake->velocity[1], *z = fake->velocity[2];
  return 0;
}
API unsigned dhdGetButtonMask(char id) {
  (void)id;
  return (unsigned)fake_map()->buttons;
}
#ifndef LACKS_A_FUNCTION
API int dhdSetForce(double x, double y, double z, char id) {
  (void)id;
  fake_device* fake = fake_map();
  if (fake->mode == FAKE_LOST || fake->mode == FAKE_REFUSES) return -1;
  fake_take_force(x, y, z);
  return 2; /* a motor at its limit: no error */
}
#endif
API const char* dhdErrorGetLastStr(void) {
  return fake_map()->mode == FAKE_ABSENT ? "no device found" : "communication error";
}
