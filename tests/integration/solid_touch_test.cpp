// A stack of plane maps becomes a scene, and a finger goes in circles on it, or rests on it while another map
// comes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "client/files/metaimage.h"
#include "tests/integration/process.h"
#include "tests/integration/touched_scene.h"

namespace teletact {
namespace {

class SolidTouch : public testing::Test {
 protected:
  std::string address() const { return "unix:" + (folder / "s"); }
  // 48 x 20 mm, 24 mm along z.
  std::string volume(const std::string& name, double origin_x_m, float value = 1e4F,
                     std::size_t slices = 12) const {
    const double spacing_z_m = 0.024 / double(slices);
    client::write_metaimage(folder / name,
                            client::MetaImage::of<float>({24, 10, slices}, {0.002, 0.002, spacing_z_m},
                                                         {origin_x_m, 0.001, -0.012 + spacing_z_m / 2},
                                                         std::vector<float>(24 * 10 * slices, value)));
    return folder / name;
  }
  test::Outcome slices(const std::vector<std::string>& more) const {
    std::vector<std::string> words{test::client_binary(), "slices", "--service", address(), "--scene", "a"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run(words, folder / "slices.log");
  }
  // Until it has been felt once: kernels are compiled by then.
  void feel_once() const {
    test::Process touch({test::client_binary(), "touch", "--service", address(), "--scene", "a",
                         "--indentation-m", "0.001", "--tactile"},
                        folder / "first.log");
    ASSERT_TRUE(touch.says("beyond homogeneous", 300)) << touch.output();
    touch.kill(SIGINT);
    EXPECT_EQ(touch.wait(30), 0) << touch.output();
  }
  // A finger in circles, recorded with its tactile images.
  test::Outcome circles(const std::vector<std::string>& more) const {
    std::vector<std::string> words{
        test::client_binary(),  "touch", "--service", address(), "--scene", "a", "--tactile", "--record",
        folder / "touch.record"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run(words, folder / "touch.log");
  }
  test::TemporaryFolder folder;
};

TEST_F(SolidTouch, OfAVolumeThatIsPublishedSliceBySlice) {
  test::Process service({test::service_binary(), "serve", "--listen", address()}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const auto refused = [&](const std::vector<std::string>& more, const std::string& why) {
    const test::Outcome outcome = slices(more);
    EXPECT_EQ(outcome.code, 1);
    EXPECT_NE(outcome.output.find(why), std::string::npos) << outcome.output;
  };
  refused({"--volume", volume("beside.mha", 0)}, "half of an ElementSpacing");
  refused({"--volume", volume("void.mha", 0.001, 0)}, "a modulus must be");
  client::write_metaimage(folder / "plane.mha", client::MetaImage::of<float>({2, 2}, {1, 1}, {0.5, 0.5},
                                                                             std::vector<float>(4, 1e4F)));
  refused({"--volume", folder / "plane.mha"}, "NDims = 3");
  refused({"--volume", folder / "none.mha"}, "none.mha");
  refused({"--volume", volume("v.mha", 0.001), "--log-std", volume("few.mha", 0.001, 0.1F, 11)}, "few.mha");
  refused({"--volume", folder / "v.mha", "--log-std", volume("none.mha", 0.001, -1)},
          "youngs_modulus_log_std[0]");

  const test::Outcome made = slices(
      {"--volume", folder / "v.mha", "--log-std", volume("log.mha", 0.001, 0.1F), "--poisson-ratio", "0.45"});
  ASSERT_EQ(made.code, 0) << made.output;
  EXPECT_NE(made.output.find("slice 12 of 12 at z 11.0 mm can be touched: version 12"), std::string::npos)
      << made.output;
  refused({"--volume", folder / "v.mha"}, "ALREADY_EXISTS");
  const test::Outcome list =
      test::run({test::client_binary(), "scenes", "--service", address()}, folder / "scenes.log");
  EXPECT_NE(list.output.find("a  extruded, 0.048 x 0.020 m"), std::string::npos) << list.output;

  feel_once();
  const test::Outcome touch =
      circles({"--indentation-m", "0.001", "--speed-m-s", "0.02", "--circle-radius-m", "0.003", "--begin-m",
               "0.014", "--end-m", "0.034", "--duration-s", "4", "--json", folder / "touch.json"});
  ASSERT_EQ(touch.code, 0) << touch.output;
  const nlohmann::json summary = nlohmann::json::parse(std::ifstream(folder / "touch.json"));
  EXPECT_EQ(summary["link"]["not_covered"], 0);
  EXPECT_GT(summary["largest_force_n"], 0.02);
  EXPECT_GT(summary["link"]["tactile_images"], 0);
}

constexpr double kRestM = 0.0025;

// A finger that twice goes down, rests for 4 s 2.5 mm deep and goes up, 12 s in all, as a recording of it.
void write_presses(const std::string& path) {
  client::RecordWriter out(path, {});
  const auto deep_m = [](double s) {
    s = std::fmod(s, 6);
    const double down = s < 3 ? (s - 0.5) / 0.5 : (5.5 - s) / 0.5;
    return -0.004 + (kRestM + 0.004) * 0.5 * (1 - std::cos(std::numbers::pi * std::clamp(down, 0.0, 1.0)));
  };
  constexpr double kStepS = 0.005;
  for (int n = 0; n * kStepS <= 12; ++n) {
    v1::RecordEntry entry;
    entry.set_monotonic_ns(std::int64_t(1e9 * kStepS) * n);
    v1::ServoSample& tick = *entry.mutable_servo();
    tick.set_state(std::uint32_t(client::ServoState::kEnabled));
    const double s = n * kStepS;
    for (const double m : {0.024, deep_m(s), 0.0}) tick.add_position_m(m);
    for (const double m_s : {0.0, (deep_m(s + 1e-4) - deep_m(s - 1e-4)) / 2e-4, 0.0})
      tick.add_velocity_m_s(m_s);
    out.append(entry);
  }
  out.close();
}

// What was felt of it.
struct Pressed {
  struct Tick {
    double time_s, y_m, force_n, energy_j;
    bool rests, on;
  };
  struct Answer {
    double time_s, force_n;
    std::uint64_t version;
  };
  std::vector<Tick> ticks{};
  std::vector<Answer> at_rest{};
};

Pressed read_presses(const std::string& path) {
  Pressed out;
  client::RecordReader reader(path);
  while (const auto entry = reader.next()) {
    const double time_s = 1e-9 * double(entry->monotonic_ns());
    if (entry->has_servo()) {
      const v1::ServoSample& s = entry->servo();
      const double y_m = s.position_m(1);
      out.ticks.push_back({time_s, y_m, std::hypot(s.force_n(0), s.force_n(1), s.force_n(2)), s.energy_j(),
                           std::abs(y_m - kRestM) < 1e-9,
                           s.state() == std::uint32_t(client::ServoState::kEnabled) && !s.faded()});
    }
    if (!entry->touch_response().has_answer()) continue;
    const v1::TouchAnswer& answer = entry->touch_response().answer();
    if (answer.position_m_size() == 3 && std::abs(answer.position_m(1) - kRestM) < 1e-9 &&
        answer.force_n_size() == 3)
      out.at_rest.push_back({time_s, -answer.force_n(1), answer.model_version()});
  }
  return out;
}

// Largest change of the force in any 10 ms of rest, over the force before.
double largest_change(const std::vector<Pressed::Tick>& ticks) {
  constexpr double kSpanS = 0.0101, kSettlesS = 0.3;
  double largest = 0, since_s = HUGE_VAL;
  std::size_t first = 0;
  for (std::size_t b = 0; b < ticks.size(); ++b) {
    const bool rests = ticks[b].rests && ticks[b].on;
    if (!rests) since_s = HUGE_VAL;
    if (rests && since_s == HUGE_VAL) since_s = ticks[b].time_s + kSettlesS;
    if (!rests || ticks[b].time_s < since_s) {
      first = b + 1;
      continue;
    }
    while (ticks[b].time_s - ticks[first].time_s > kSpanS) ++first;
    for (std::size_t a = first; a < b; ++a)
      largest = std::max(largest, std::abs(ticks[b].force_n - ticks[a].force_n) / ticks[a].force_n);
  }
  return largest;
}

// All of the solid becomes twice as hard under a resting finger, and soft again. A hand at rest pays for no
// harder tissue: that is felt from the next touch on. Softer tissue is felt at once, and both slowly.
TEST_F(SolidTouch, SliceUnderTheFingerIsFeltGradually) {
  test::Process service({test::service_binary(), "serve", "--listen", address()}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const test::Outcome made = slices({"--volume", volume("one.mha", 0.001, 2e4F, 1)});
  ASSERT_EQ(made.code, 0) << made.output;
  feel_once();
  write_presses(folder / "motion.record");
  const auto stub = v1::Palpation::NewStub(client::make_channel(address()));
  const auto publish = [&](float pa) {
    v1::PublishSliceRequest request;
    request.set_scene_id("a");
    for (int k = 0; k < 3; ++k) request.mutable_slice()->mutable_pose()->add_origin_m(0);
    v1::Array& array = *request.mutable_slice()->mutable_modulus()->mutable_youngs_modulus_pa();
    array.set_dtype(v1::DATA_TYPE_FLOAT32);
    array.add_shape(10), array.add_shape(24);
    const std::vector<float> values(240, pa);
    array.set_data(values.data(), values.size() * sizeof(float));
    grpc::ClientContext context;
    v1::PublishSliceResponse response;
    const grpc::Status status = stub->PublishSlice(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.version();
  };
  test::Process touch({test::client_binary(), "touch", "--service", address(), "--scene", "a", "--device",
                       "replay:" + (folder / "motion.record"), "--record", folder / "touch.record"},
                      folder / "touch.log");
  ASSERT_TRUE(test::finger_presses(address(), "a", kRestM - 1e-5, 60)) << touch.output();
  std::this_thread::sleep_for(std::chrono::seconds(1));
  const std::uint64_t hard = publish(4e4F);
  std::this_thread::sleep_for(std::chrono::seconds(6));  // it has gone up, and down again
  const std::uint64_t soft = publish(2e4F);
  ASSERT_EQ(touch.wait(60), 0) << touch.output();

  const Pressed felt = read_presses(folder / "touch.record");
  EXPECT_LT(largest_change(felt.ticks), 0.07);
  // What answers of a version tell at rest, and what was written by the end of that.
  struct Told {
    double force_n = 0, written_n = 0;
  };
  std::map<std::uint64_t, Told> told;
  for (const Pressed::Answer& answer : felt.at_rest) {
    const auto at = std::upper_bound(felt.ticks.begin(), felt.ticks.end(), answer.time_s,
                                     [](double s, const auto& tick) { return s < tick.time_s; });
    if (at != felt.ticks.end() && at->rests && at->on) told[answer.version] = {answer.force_n, at->force_n};
  }
  ASSERT_EQ(told.size(), 3u);
  const Told before = told.begin()->second;
  EXPECT_NEAR(told[hard].force_n, 2 * before.force_n, 0.02 * before.force_n);
  EXPECT_NEAR(told[soft].force_n, before.force_n, 0.02 * before.force_n);
  for (const auto& [version, there] : told)
    EXPECT_NEAR(there.written_n, there.force_n, 0.03 * there.force_n) << version;
  // Of either touch: the hand gets back no more than it gave, but for what the mechanism's friction takes.
  double given_j = 0, max_j = 0, returned_j = 0;
  const double friction_n = client::device_profile("premium-1.5").friction_n;
  for (std::size_t n = 1; n < felt.ticks.size(); ++n) {
    const Pressed::Tick &a = felt.ticks[n - 1], &b = felt.ticks[n];
    if (b.y_m < 0) given_j = 0;
    given_j += a.force_n * (b.y_m - a.y_m) + friction_n * std::abs(b.y_m - a.y_m);
    max_j = std::max(max_j, given_j);
    returned_j = std::max(returned_j, -given_j);
    EXPECT_GE(b.energy_j, -1e-9) << n;
  }
  std::printf(
      "[ felt  ] %.4f of the force in 10 ms at most; %.3f, %.3f and %.3f N at rest; back of %.2g J: %.2g J\n",
      largest_change(felt.ticks), before.written_n, told[hard].written_n, told[soft].written_n, max_j,
      returned_j);
  EXPECT_GT(max_j, 2e-4);
  EXPECT_LE(returned_j, 0.01 * max_j);
}

// The demo of solids in short, with its report; and what that says of another patient.
TEST_F(SolidTouch, OfTheSimulatedPatientIsHeldAgainstItsOwnTissue) {
  test::Process service({test::service_binary(), "serve", "--listen", address()}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const test::Outcome made = slices({"--seed", "7"});
  ASSERT_EQ(made.code, 0) << made.output;
  feel_once();
  const test::Outcome touch = circles({"--indentation-m", "0.002", "--speed-m-s", "0.01", "--circle-radius-m",
                                       "0.004", "--begin-m", "0.03", "--end-m", "0.08", "--duration-s", "5"});
  ASSERT_EQ(touch.code, 0) << touch.output;
  const auto felt = [&](const std::string& seed, nlohmann::json& summary) {
    const test::Outcome outcome = test::run(
        {test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-felt", "--touch-record",
         folder / "touch.record", "--seed", seed, "--poses", "4", "--out", folder / seed},
        folder / "felt.log", {}, 300);
    std::ifstream file(folder / (seed + "/summary.json"));
    summary = nlohmann::json::parse(file, nullptr, false);
    if (!summary.is_object()) throw std::runtime_error(outcome.output);
    return outcome;
  };
  nlohmann::json own, others;
  const test::Outcome met = felt("7", own), missed = felt("8", others);
  EXPECT_LT(own["force_error"]["median"], 0.02) << met.output;
  EXPECT_EQ(own["force_error"]["samples"], 4) << met.output;
  EXPECT_GT(own["plane_error"]["median"], 0.02) << met.output;
  EXPECT_LT(std::abs(own["truths_nodes"]["median"].get<double>()), 0.005) << met.output;
  EXPECT_LT(std::abs(own["truths_nodes"]["min"].get<double>()), 0.01) << met.output;
  EXPECT_EQ(own["stalls"]["count"], 0) << met.output;
  for (const char* file : {"force.png", "tactile.png", "latency.png"})
    EXPECT_TRUE(std::filesystem::exists(folder / ("7/" + std::string(file)))) << file;
  EXPECT_EQ(missed.code, 2) << missed.output;
  EXPECT_GT(others["force_error"]["median"], 0.02) << missed.output;
  EXPECT_NE(missed.output.find("NOT MET       force_error median"), std::string::npos) << missed.output;
}

}  // namespace
}  // namespace teletact
