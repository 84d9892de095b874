// What keeps a quiet link alive between proxies that drop idle connections.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <thread>

#include "client/link/channel.h"
#include "client/link/touch_link.h"
#include "tests/link/fake_palpation.h"
#include "tests/support/fault_proxy.h"

namespace teletact::client {
namespace {

// GIVEN a proxy that drops what is idle for 0.5 s WHEN the servo gives one pose and no more THEN heartbeats
// keep the stream: the one connection lives, and answers go on.
TEST(IdleLink, AStreamWithoutPosesIsKeptByItsHeartbeats) {
  constexpr double kIdleS = 0.5;
  constexpr int kHeartbeats = 5;  // in that time
  static_assert(kIdleS >= kHeartbeats * TouchLink::kHeartbeatS);
  test::FakePalpation service(test::socket_address("idle"));
  service.serve();
  teletact::test::FaultProxy proxy(test::socket_address("idle"));
  proxy.play({.faults = {.idle_s = kIdleS}});
  MonotonicClock clock;
  LatestSlot<ServoPose> poses;
  LatestSlot<ServoAnswer> answers;
  TouchLinkOptions options;
  options.address = proxy.address();
  options.open.set_scene_id("s");
  options.open.set_period_s(0.001);
  ServoPose pose;
  pose.pose.position_m = Vector3(0.02, 0.004, 0);
  pose.time_ns = clock.now_ns();
  poses.put(pose);
  TouchLink link(options, poses, answers, clock);
  link.start();
  ASSERT_TRUE(service.wait_until(test::answers_at_least(1)));
  EXPECT_TRUE(service.wait_until(test::answers_at_least(1 + 2 * kHeartbeats)));
  link.stop();
  EXPECT_EQ(link.stats().streams, 1u);
  EXPECT_EQ(proxy.connections(), 1u);
}

// The second net, too slow to wait for here: every channel asks for it.
TEST(IdleLink, EveryChannelHasKeepalive) {
  const grpc::ChannelArguments all = channel_arguments();
  const grpc_channel_args arguments = all.c_channel_args();
  const grpc_arg* const begin = arguments.args;
  const grpc_arg* const end = begin + arguments.num_args;
  const grpc_arg* const keepalive = std::find_if(begin, end, [](const grpc_arg& argument) {
    return std::strcmp(argument.key, GRPC_ARG_KEEPALIVE_TIME_MS) == 0;
  });
  ASSERT_NE(keepalive, end);
  EXPECT_EQ(keepalive->type, GRPC_ARG_INTEGER);
  EXPECT_GE(keepalive->value.integer, 10'000);  // or a service takes the pings for an attack
  EXPECT_LE(keepalive->value.integer, 60'000);  // the shortest idle limit that proxies are known for
}

}  // namespace
}  // namespace teletact::client
