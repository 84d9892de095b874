#include "bench/load/recorded_finger.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "client/link/recording.h"

namespace teletact::bench {
namespace {

const std::string kPath = "/tmp/teletact-recorded-finger-" + std::to_string(getpid());

// Poses at 10, 30 and 20 ms after each other, at x = 0, 1, 2, 3 mm.
void write(const char* kind, int poses) {
  v1::RecordHeader header;
  header.set_kind(kind);
  header.set_scene_id("s");
  header.set_version(client::kRecordingVersion);
  client::RecordWriter writer(kPath, header);
  v1::TouchRequest request;
  request.mutable_open()->set_laws(true);
  writer.append_waiting(client::recorded(request, 1'000'000'000, 1));
  std::int64_t ns = 2'000'000'000;
  for (int k = 0; k < poses; ++k) {
    ns += k == 0 ? 0 : k % 3 == 1 ? 10'000'000 : k % 3 == 2 ? 30'000'000 : 20'000'000;
    request.mutable_pose()->Clear();
    for (const double x_m : {1e-3 * k, 0.002, 0.0}) request.mutable_pose()->add_position_m(x_m);
    writer.append_waiting(client::recorded(request, ns, 1));
  }
  writer.close();
}

class RecordedFingerTest : public testing::Test {
 protected:
  ~RecordedFingerTest() override { std::filesystem::remove(kPath); }
};

TEST_F(RecordedFingerTest, IsDoneOverAndOverAtItsOwnInstants) {
  write("touch", 4);
  const auto touch = read_recorded_touch(kPath);
  EXPECT_EQ(touch->scene_id, "s");
  EXPECT_TRUE(touch->open.laws());
  EXPECT_NEAR(touch->length_s, 0.08, 1e-12) << "60 ms and a usual interval";
  for (const unsigned client : {0u, 1u, 7u}) {
    RecordedFinger finger(touch, client);
    double last_s = finger.next();
    EXPECT_GE(last_s, 0);
    for (int k = 0; k < 20; ++k) {
      const double x_m = finger.at(last_s).position_m[0], time_s = finger.next();
      const int pose = static_cast<int>(std::lround(1e3 * x_m));
      const double expected_s[] = {0.01, 0.03, 0.02, 0.02};
      EXPECT_NEAR(time_s - last_s, expected_s[pose], 1e-9) << client << ", " << k;
      EXPECT_NEAR(finger.at(time_s).position_m[0], 1e-3 * ((pose + 1) % 4), 1e-12) << client << ", " << k;
      last_s = time_s;
    }
  }
  EXPECT_NE(RecordedFinger(touch, 0).next(), RecordedFinger(touch, 1).next());
}

TEST_F(RecordedFingerTest, WhatIsNoTouchIsRefused) {
  EXPECT_THROW(read_recorded_touch("/nowhere"), std::runtime_error);
  write("acquire", 4);
  EXPECT_THROW(read_recorded_touch(kPath), std::runtime_error);
  write("touch", 1);
  EXPECT_THROW(read_recorded_touch(kPath), std::runtime_error);
}

}  // namespace
}  // namespace teletact::bench
