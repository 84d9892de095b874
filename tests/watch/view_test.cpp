// What the view makes of an acquisition's entries.
#include "client/watch/view.h"

#include <gtest/gtest.h>

#include "tests/watch/web_peer.h"

namespace teletact::client {
namespace {

v1::RecordEntry asked(std::uint32_t call, double x_m) {
  v1::RecordEntry entry;
  entry.set_call(call);
  for (const double origin_m : {x_m, 0.0, 0.0})
    entry.mutable_estimate_request()
        ->mutable_acquisition()
        ->mutable_publish()
        ->mutable_window()
        ->add_origin_m(origin_m);
  return entry;
}

v1::RecordEntry stage(std::uint32_t call, v1::EstimateStage reached) {
  v1::RecordEntry entry;
  entry.set_call(call);
  entry.mutable_estimate_response()->mutable_progress()->set_stage(reached);
  return entry;
}

v1::RecordEntry published(std::uint32_t call) {
  v1::RecordEntry entry;
  entry.set_call(call);
  entry.mutable_estimate_response()->mutable_summary()->add_warnings("wrong-force: the modulus is 3 times");
  return entry;
}

nlohmann::json newest(View& view, Channel channel) {
  View::Seen seen;
  return test::decoded(frame(1, view.news(seen))).slots.at(static_cast<std::uint32_t>(channel)).json;
}

// One whose pair could not be tracked says nothing more: the next one's beginning tells.
TEST(View, AWindowThatCameToNothingIsSaid) {
  View view;
  view.take(asked(1, 0.0));
  view.take(stage(1, v1::ESTIMATE_STAGE_STRAIN));
  view.take(published(1));
  view.take(asked(2, 0.06));
  view.take(stage(2, v1::ESTIMATE_STAGE_RECEIVED));
  nlohmann::json windows = newest(view, Channel::kWindows)["windows"];
  ASSERT_EQ(windows.size(), 2u);
  EXPECT_EQ(windows[0]["stage"], "published");
  EXPECT_EQ(windows[0]["warnings"][0], "wrong-force: the modulus is 3 times");
  EXPECT_EQ(windows[1]["stage"], "received") << "it may still come";
  view.take(asked(3, 0.06));
  windows = newest(view, Channel::kWindows)["windows"];
  ASSERT_EQ(windows.size(), 3u);
  EXPECT_EQ(windows[0]["stage"], "published");
  EXPECT_EQ(windows[1]["stage"], "not published");
  EXPECT_EQ(windows[2]["stage"], "sent");
}

// It counts its calls from the beginning, too.
TEST(View, AnotherAcquisitionHasItsOwnWindows) {
  View view;
  view.take(asked(1, 0.0));
  view.take(published(1));
  view.take(asked(60, 0.0));
  v1::RecordEntry begins;
  begins.mutable_header()->set_kind("acquire");
  view.take(begins);
  view.take(asked(1, 0.03));
  const nlohmann::json windows = newest(view, Channel::kWindows)["windows"];
  ASSERT_EQ(windows.size(), 1u);
  EXPECT_EQ(windows[0]["stage"], "sent");
  EXPECT_FALSE(windows[0].contains("warnings"));
}

TEST(View, WhatThePatientSideSaysStandsInTheLog) {
  View view;
  v1::RecordEntry entry;
  entry.set_monotonic_ns(2'000'000'000);
  entry.mutable_log()->set_warning(true);
  entry.mutable_log()->set_text("patient side: Estimate: FAILED_PRECONDITION");
  view.take(entry);
  const nlohmann::json lines = newest(view, Channel::kStatus)["log"];
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines[0]["text"], "patient side: Estimate: FAILED_PRECONDITION");
  EXPECT_EQ(lines[0]["warning"], true);
}

TEST(View, AWindowWithoutEvidenceWasGiven) {
  View view;
  v1::Scene scene;
  scene.add_windows();
  scene.add_windows()->mutable_evidence()->set_quality(1);
  view.take_scene(scene);
  const nlohmann::json windows = newest(view, Channel::kScene)["windows"];
  ASSERT_EQ(windows.size(), 2u);
  EXPECT_EQ(windows[0]["given"], true);
  EXPECT_EQ(windows[1]["given"], false);
}

// A session that ends brings no tick behind its last, which would else never be shown.
TEST(View, TheLastTicksAreARowOnceTheyWaitForNoMore) {
  View view;
  v1::RecordEntry tick;
  tick.set_monotonic_ns(2'000'000'000);
  tick.mutable_servo()->set_state(1);
  view.take(tick);
  const auto rows = [&] { return newest(view, Channel::kTrace)["arrays"][0]["shape"][0]; };
  view.complete_row();
  EXPECT_EQ(rows(), 1);
  view.complete_row();
  EXPECT_EQ(rows(), 1) << "once";
  tick.set_monotonic_ns(2'001'000'000);
  view.take(tick);
  EXPECT_EQ(rows(), 1) << "a row of its own is open";
}

}  // namespace
}  // namespace teletact::client
