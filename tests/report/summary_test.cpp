#include "client/report/summary.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace teletact::client {
namespace {

using nlohmann::json;

constexpr double kBegin = 1000;  // when the first answer arrived, s

// 1 s at 1 kHz; an answer every 4 ms with 2 ms of latency; the finger moves during the first half only.
TouchRecord touch() {
  TouchRecord record;
  for (int k = 0; k <= 1000; ++k) {
    TouchTick tick;
    tick.time_s = kBegin + 0.001 * k;
    tick.lateness_s = k % 100 == 0 ? 0.0015 : 0.00005;
    tick.at_border = k >= 200 && k < 230;
    record.ticks.push_back(tick);
  }
  for (int k = 0; k <= 250; ++k)
    record.answers.push_back({kBegin + 0.004 * k, 0.002, 1e-4 * std::min(k, 125), 0.004, 0, {}});
  return record;
}

AcquireRecord acquire() {
  AcquireRecord record;
  record.windows = {{0.00, kBegin - 1, 2.0, 0.9},  // before the touch: not what p95 is promised of
                    {0.06, kBegin + 0.3, 0.6, 0.2},
                    {0.12, kBegin + 0.6, 0.8, 0.4}};
  return record;
}

Tissue tissue() {
  Tissue tissue;
  tissue.inclusions = {{0.05, 0.012, 0.010, 5.0}, {0.15, 0.012, 0.012, 4.0}};
  return tissue;
}

InclusionReport one_found_one_missed_one_invented() {
  InclusionReport report;
  report.background_pa = 10e3;
  report.found = {{0.051, 0.012, 0.009, 3.5}, {0.25, 0.02, 0.006, 1.8}};
  report.match = {0, -1};
  report.spurious = {1};
  return report;
}

ForceError force() {
  ForceError force;
  force.median = 0.03;
  force.p95 = 0.1;
  force.coverage = 0.95;
  force.judged = 100;
  return force;
}

json summary() {
  return summarise(tissue(), touch(), acquire(), force(), one_found_one_missed_one_invented(), "1.2.3");
}

const json& target(const json& summary, const std::string& name) {
  for (const json& t : summary.at("targets"))
    if (t.at("name") == name) return t;
  throw std::runtime_error("no target " + name);
}

TEST(Summary, HasThePromisedKeys) {
  const json s = summary();
  for (const char* key : {"windows", "stalls", "window_s", "window_request_s", "touch_rate_hz",
                          "touch_latency_s", "servo", "force_error", "inclusions", "device", "versions"})
    EXPECT_TRUE(s.contains(key)) << key;
  for (const char* key : {"count", "s"}) EXPECT_TRUE(s["stalls"].contains(key)) << key;
  for (const char* key : {"p50", "p95", "max"}) {
    EXPECT_TRUE(s["window_s"].contains(key)) << key;
    EXPECT_TRUE(s["window_request_s"].contains(key)) << key;
  }
  for (const char* key : {"p50", "p99", "max"}) EXPECT_TRUE(s["touch_latency_s"].contains(key)) << key;
  for (const char* key : {"rate_hz", "overruns", "lateness_s_p99"})
    EXPECT_TRUE(s["servo"].contains(key)) << key;
  for (const char* key : {"median", "p95", "coverage"}) EXPECT_TRUE(s["force_error"].contains(key)) << key;
  for (const char* key : {"true", "found", "false"}) EXPECT_TRUE(s["inclusions"].contains(key)) << key;
}

TEST(Summary, ARestingFingerAddsNoTouches) {
  const json s = summary();
  EXPECT_NEAR(s["touch_rate_hz"].get<double>(), 125, 1e-6);  // 126 places in 1 s, not 251 answers
  EXPECT_EQ(s["answers"]["count"].get<int>(), 251);
  EXPECT_FALSE(target(s, "touch_rate_hz")["met"].get<bool>());
}

TEST(Summary, TargetsAllowForLawsAndTheRoundTrip) {
  TouchRecord record = touch();
  const auto summed = [&] {
    return summarise(tissue(), record, acquire(), force(), one_found_one_missed_one_invented(), "1.2.3");
  };
  EXPECT_EQ(summed()["by_law_share"].get<double>(), 0);  // a recording from before
  EXPECT_EQ(target(summed(), "touch_rate_hz")["target"].get<double>(), 200);
  for (std::size_t k = 0; k < record.ticks.size(); ++k) {
    record.ticks[k].enabled = k > 0;
    record.ticks[k].by_law = k > 250;
    record.ticks[k].round_trip_s = k > 100 ? 0.1 : 0;  // not known at first
  }
  for (TouchAnswerTime& answer : record.answers) answer.latency_s = 0.109;
  EXPECT_EQ(summed()["by_law_share"].get<double>(), 0.75);
  EXPECT_NEAR(target(summed(), "touch_rate_hz")["target"].get<double>(), 0.75 * 18 + 0.25 * 200, 1e-9);
  const std::string latency = "touch_latency_s p99 beyond the round trip";
  EXPECT_NEAR(target(summed(), latency)["value"].get<double>(), 0.009, 1e-9);
  EXPECT_TRUE(target(summed(), latency)["met"].get<bool>());
}

TEST(Summary, WindowsAreTimedWhileTouchingGoesOn) {
  const json s = summary();
  EXPECT_EQ(s["windows"].get<int>(), 3);
  EXPECT_EQ(s["windows_while_touching"].get<int>(), 2);
  EXPECT_NEAR(s["window_s"]["max"].get<double>(), 0.4, 1e-12);
  EXPECT_NEAR(s["window_request_s"]["p50"].get<double>(), 0.6, 1e-12);
}

TEST(Summary, StallsAndOverrunsAreCountedFromTheTicks) {
  const json s = summary();
  EXPECT_EQ(s["stalls"]["count"].get<int>(), 1);
  EXPECT_NEAR(s["stalls"]["s"].get<double>(), 0.030, 1e-9);
  EXPECT_EQ(s["servo"]["overruns"].get<int>(), 11);
  EXPECT_NEAR(s["servo"]["rate_hz"].get<double>(), 1000, 1e-6);
  EXPECT_FALSE(target(s, "stalls")["met"].get<bool>());
}

TEST(Summary, DoubtIsCountedWhereTheRecordingSaysIt) {
  TouchRecord record = touch();
  const auto summed = [&] {
    return summarise(tissue(), record, acquire(), force(), one_found_one_missed_one_invented(), "1.2.3");
  };
  EXPECT_TRUE(summed()["degraded"].is_null());  // a recording from before: not known, which is not zero
  EXPECT_TRUE(summed()["faded"].is_null());
  for (std::size_t k = 0; k < record.ticks.size(); ++k) {
    TouchTick& tick = record.ticks[k];
    tick.enabled = k >= 100;
    tick.degraded = k < 200 || (k >= 500 && k < 600);  // of the first 200 the last 100 with force on
    tick.faded = false;
    tick.service_degraded = k == 700;
  }
  EXPECT_EQ(summed()["degraded"]["count"].get<int>(), 2);
  EXPECT_NEAR(summed()["degraded"]["s"].get<double>(), 0.2, 1e-9);
  EXPECT_EQ(summed()["faded"]["count"].get<int>(), 0);
  EXPECT_EQ(summed()["service_degraded"]["count"].get<int>(), 1);
}

TEST(Summary, NamesMissedAndInventedInclusions) {
  const json s = summary();
  EXPECT_EQ(s["inclusions"]["missed"].get<int>(), 1);
  ASSERT_EQ(s["inclusions"]["false"].size(), 1u);
  EXPECT_NEAR(s["inclusions"]["true"][0]["found_contrast"].get<double>(), 3.5, 1e-12);
  EXPECT_NEAR(s["inclusions"]["true"][0]["distance_m"].get<double>(), 0.001, 1e-12);
  EXPECT_FALSE(target(s, "inclusions missed")["met"].get<bool>());
  EXPECT_FALSE(target(s, "inclusions invented")["met"].get<bool>());
  const std::string table = readable(s) + not_met(s);
  for (const char* words : {"5.0 / 3.5 (true / found), 1.0 mm off", "4.0 / MISSED", "INVENTED", "NOT MET"})
    EXPECT_NE(table.find(words), std::string::npos) << words << " is not in:\n" << table;
}

// Where no window was acquired nothing can be found: that is said, and not held against the run.
TEST(Summary, AnInclusionWhereNobodyAcquiredIsNotMissed) {
  AcquireRecord record = acquire();
  const auto end_at = [&](double end_x_m) {
    v1::Scene scene;
    scene.add_windows()->mutable_covers()->set_end_x_m(end_x_m);
    record.scene = scene;
    return summarise(tissue(), touch(), record, force(), one_found_one_missed_one_invented(), "1.2.3");
  };
  const json beside = end_at(0.1499), over = end_at(0.1501);  // the second inclusion lies at 0.15 m
  EXPECT_FALSE(beside["inclusions"]["true"][1]["acquired"].get<bool>());
  EXPECT_EQ(beside["inclusions"]["missed"].get<int>(), 0);
  EXPECT_TRUE(target(beside, "inclusions missed")["met"].get<bool>());
  EXPECT_NE(readable(beside).find("4.0 / not acquired"), std::string::npos) << readable(beside);
  EXPECT_EQ(readable(beside).find("MISSED"), std::string::npos);
  EXPECT_EQ(over["inclusions"]["missed"].get<int>(), 1);
  EXPECT_NE(readable(over).find("4.0 / MISSED"), std::string::npos);
}

TEST(Summary, OfATouchAloneSaysWhatItsRecordingTells) {
  TouchRecord record = touch();
  record.malformed_images = 3;
  json s = summarise(record, "1.2.3");
  for (const char* key : {"stalls", "touch_latency_s", "servo"}) EXPECT_EQ(s[key], summary()[key]) << key;
  for (const char* key : {"windows", "force_error", "inclusions"}) EXPECT_FALSE(s.contains(key)) << key;
  EXPECT_NE(readable(s).find("0 images, 3 malformed and left out"), std::string::npos) << readable(s);
  EXPECT_NE(not_met(s).find("stalls: 1 instead of 0"), std::string::npos) << not_met(s);
  EXPECT_FALSE(set_targets(s, {{"a", 1, 0}, {"b", 0, 0}}));
  EXPECT_EQ(not_met(s), "NOT MET       a: 1 instead of 0 \n");
  EXPECT_TRUE(set_targets(s, {{"b", 0, 0}}));
  record.answers.clear();
  EXPECT_THROW(summarise(record, "1.2.3"), std::runtime_error);
}

TEST(Summary, AFigureThatIsNoNumberIsNotMet) {
  Promise figure{"x", std::numeric_limits<double>::quiet_NaN(), 1, "s"};
  EXPECT_FALSE(figure.met());
  figure.at_most = false;
  EXPECT_FALSE(figure.met());
}

TEST(Summary, ModulusThatWasNotMeasuredIsNaN) {
  AcquireRecord record;
  v1::Scene& scene = record.scene.emplace();
  v1::Map& map = *scene.mutable_youngs_modulus();
  for (const std::uint32_t size : {2U, 1U}) {
    map.mutable_grid()->add_size(size);
    map.mutable_grid()->add_origin_m(0);
    map.mutable_grid()->add_spacing_m(0.001);
  }
  const std::vector<float> pa{10e3F, 10e3F};
  map.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT32);
  map.mutable_values()->set_data(pa.data(), pa.size() * sizeof(float));
  scene.mutable_valid()->mutable_values()->set_data(std::string("\1\0", 2));
  const ModulusGrid grid = measured_modulus(record);
  ASSERT_EQ(grid.pa.size(), 2u);
  EXPECT_EQ(grid.pa[0], 10e3F);
  EXPECT_TRUE(std::isnan(grid.pa[1]));
}

// Recordings of different scenes or times are no pair; what only may be none is said.
TEST(Sessions, RecordingsThatDoNotBelongTogetherAreToldApart) {
  TouchRecord touched = touch();
  AcquireRecord acquired = acquire();
  touched.scene_id = acquired.scene_id = "a";
  EXPECT_EQ(session_mismatch(touched, acquired), "");
  touched.instances = {7, 8};
  acquired.info.emplace().set_instance(8);
  acquired.scene.emplace().set_version(3);
  touched.model_version = 3;
  EXPECT_EQ(session_mismatch(touched, acquired), "");
  touched.model_version = 4;
  EXPECT_NE(session_mismatch(touched, acquired).find("newer"), std::string::npos);
  acquired.info->set_instance(9);
  EXPECT_NE(session_mismatch(touched, acquired).find("two runs of the service"), std::string::npos);
  for (AcquiredWindow& window : acquired.windows) window.published_s += 3;
  EXPECT_THROW(session_mismatch(touched, acquired), std::runtime_error);
  acquired = acquire();
  acquired.scene_id = "b";
  EXPECT_THROW(session_mismatch(touched, acquired), std::runtime_error);
}

}  // namespace
}  // namespace teletact::client
