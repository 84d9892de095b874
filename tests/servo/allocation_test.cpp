// Nothing in the loop takes memory: not in contact only, but through everything that befalls a session.
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "client/render/renderers.h"
#include "tests/servo/servo_test.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::client {
namespace {

class AllocationTest : public test::ServoTest, public ::testing::WithParamInterface<std::string> {
 protected:
  AllocationTest() {
    rendering_ = make_renderer(GetParam(), options.period_s);
    servo = std::make_unique<ServoLoop>(device, *rendering_, clock, options);
  }
  // Lifted, asked for force, pressed.
  void press_again() {
    put_finger(-0.003);
    run(0.05);
    servo->request_resume();
    run(0.01);
    put_finger(0.004);
    run(0.7);
  }

 private:
  std::unique_ptr<Renderer> rendering_;
};

TEST_P(AllocationTest, ContactReconnectAndFaultAllocateNothing) {
  teletact::test::count_allocations(true);
  press_again();
  const double pressed_n = device.force.norm();
  tissue.stiffness *= 3;  // a window hand-over while pressed
  run(0.3);
  const double handed_over_n = device.force.norm(), withheld = last.withheld;
  silent = true;  // the link is gone, and comes back
  run(0.4);
  const ServoState without_link = last.state;
  silent = false;
  press_again();
  const double resumed_n = device.force.norm();
  device.ok = false;  // so is the device
  run(0.02);
  const ServoState without_device = last.state;
  device.ok = true;
  press_again();
  teletact::test::count_allocations(false);
  EXPECT_EQ(teletact::test::counted_allocations(), 0u);
  // Or nothing would have been claimed:
  EXPECT_GT(pressed_n, 0.2);
  EXPECT_TRUE(handed_over_n > 1.5 * pressed_n || withheld > 0.2) << handed_over_n << " N, " << withheld;
  EXPECT_EQ(without_link, ServoState::kPaused);
  EXPECT_GT(resumed_n, 1.5 * pressed_n);
  EXPECT_EQ(without_device, ServoState::kFault);
  EXPECT_GT(device.force.norm(), 0.3);
}

INSTANTIATE_TEST_SUITE_P(Renderers, AllocationTest, ::testing::ValuesIn(renderer_names()),
                         [](const auto& test) { return test.param; });

}  // namespace
}  // namespace teletact::client
