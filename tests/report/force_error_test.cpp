#include "client/report/force_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace teletact::client {
namespace {

Tissue small_tissue() {
  Tissue tissue;
  tissue.width_m = 0.12;
  tissue.depth_m = 0.02;
  return tissue;
}

// A finger that presses 2 mm and moves at 120 mm/s, feeling `gain` times the true force; force comes on at
// 0.1 s.
TouchRecord touch(const Patient& patient, double gain, double duration_s) {
  TouchRecord record;
  for (double t = 0; t < duration_s; t += 0.001) {
    TouchTick tick;
    tick.time_s = 100 + t;
    tick.x_m = 0.03 + 0.06 * t / duration_s;
    tick.indentation_m = 0.002;
    tick.enabled = t >= 0.1;
    const bool ramp = t < 0.6;
    const TouchForce truth = std::fmod(t, 0.005) < 0.001 ? patient.touch({}, tick.x_m, 0.002) : TouchForce{};
    tick.force_x_n = ramp ? 0 : gain * truth.force_n[0];
    tick.force_y_n = ramp ? 0 : gain * truth.force_n[1];
    if (std::fmod(t, 0.005) < 0.001) record.ticks.push_back(tick);
  }
  return record;
}

TEST(ForceError, IsZeroForTheTrueForceAndTheGainsOtherwise) {
  const Patient patient(small_tissue(), 0.001);
  const ForceError exact = force_error(patient, touch(patient, 1.0, 1.1));
  EXPECT_NEAR(exact.p95, 0, 1e-9);
  EXPECT_NEAR(exact.coverage, 1, 1e-9);  // the start ramp is not part of the path
  EXPECT_GE(exact.judged, 30u);
  const ForceError soft = force_error(patient, touch(patient, 0.8, 1.1));
  EXPECT_NEAR(soft.median, 0.2, 1e-9);
  EXPECT_NEAR(soft.p95, 0.2, 1e-9);
}

TEST(ForceError, WhatIsNotFeltLowersTheCoverage) {
  const Patient patient(small_tissue(), 0.001);
  TouchRecord record = touch(patient, 1.0, 1.1);
  // Force is off for the last but one quarter: that part of the path is not covered, and a ramp follows.
  for (TouchTick& tick : record.ticks)
    if (tick.time_s > 100.8 && tick.time_s < 100.9) tick.enabled = false;
  const ForceError error = force_error(patient, record);
  EXPECT_LE(error.coverage, 0.75);
  EXPECT_GE(error.coverage, 0.5);
}

TEST(ForceError, NothingFeltIsAnError) {
  const Patient patient(small_tissue(), 0.001);
  TouchRecord record = touch(patient, 1.0, 0.3);  // all of it in the ramp
  EXPECT_THROW(force_error(patient, record), std::runtime_error);
  record.layer_depth_m = 0.01;
  EXPECT_THROW(force_error(patient, record), std::runtime_error);
}

}  // namespace
}  // namespace teletact::client
