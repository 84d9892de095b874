// What the view makes of an acquisition's entries.
#include "client/watch/view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>

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

test::WebSlot newest_slot(View& view, Channel channel) {
  View::Seen seen;
  return test::decoded(frame(1, view.news(seen))).slots.at(static_cast<std::uint32_t>(channel));
}

nlohmann::json newest(View& view, Channel channel) {
  return newest_slot(view, channel).json;
}

v1::RecordEntry tick_at(std::int64_t time_ns) {
  v1::RecordEntry entry;
  entry.set_monotonic_ns(time_ns);
  entry.mutable_servo()->set_state(1);
  return entry;
}

// A value of the last row of the trace.
float last_of(View& view, const std::string& column) {
  const test::WebSlot slot = newest_slot(view, Channel::kTrace);
  Trace::Row row;
  const std::size_t rows = slot.data.size() / sizeof(row);  // filled up to 8 bytes
  std::memcpy(row.data(), slot.data.data() + (rows - 1) * sizeof(row), sizeof(row));
  return row.at(
      static_cast<std::size_t>(std::ranges::find(Trace::columns(), column) - Trace::columns().begin()));
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
  view.take(tick_at(2'000'000'000));
  const auto rows = [&] { return newest(view, Channel::kTrace)["arrays"][0]["shape"][0]; };
  view.complete_row();
  EXPECT_EQ(rows(), 1);
  view.complete_row();
  EXPECT_EQ(rows(), 1) << "once";
  view.take(tick_at(2'001'000'000));
  EXPECT_EQ(rows(), 1) << "a row of its own is open";
}

TEST(View, ARowIsAsLateAsTheLatestOfItsTicks) {
  View view;
  for (int n = 0; n < 10; ++n) {
    v1::RecordEntry tick = tick_at(2'000'000'000 + n * std::int64_t{1'000'000});
    tick.mutable_servo()->set_lateness_s(n == 2 ? 0.005 : 1e-5);
    view.take(tick);
  }
  view.complete_row();
  EXPECT_EQ(last_of(view, "lateness_s"), 0.005F);
}

TEST(View, AnAnswerWithoutAnIntervalIsDrawnWithNone) {
  View view;
  auto drawn = [&, time_ns = std::int64_t{0}](std::optional<double> half_width) mutable {
    v1::RecordEntry answer;
    v1::TouchAnswer& said = *answer.mutable_touch_response()->mutable_answer();
    if (half_width) {
      said.mutable_budget()->set_half_width(*half_width);
      said.mutable_budget()->set_above(0.5);
      v1::ForceError& error = *said.mutable_budget()->add_terms();
      error.set_term(v1::ForceError::TERM_MODULUS), error.set_relative(*half_width / 1.96);
    }
    view.take(answer);
    view.take(tick_at(time_ns += 1'000'000'000));
    view.complete_row();
    return last_of(view, "half_width");
  };
  EXPECT_EQ(drawn(0.25), 0.25F);
  EXPECT_EQ(last_of(view, "above"), 0.5F);
  const std::string largest = newest(view, Channel::kStatus)["answer"]["largest_term"];
  EXPECT_EQ(largest.find("the modulus, without which it would be 25 % of the force narrower: "), 0U)
      << largest;
  EXPECT_TRUE(std::isnan(drawn({})));
}

}  // namespace
}  // namespace teletact::client
