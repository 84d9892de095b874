// Estimates through the contract: what they give.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <vector>

#include "service/rpc/estimate_messages.h"
#include "tests/rpc/estimates.h"

namespace teletact::service {
namespace {

TEST_F(Estimates, PairBecomesAWindowThatCanBeTouched) {
  v1::Acquisition a = acquisition("scene", 0.04);
  a.set_modulus_time_limit_s(20);  // one that is stopped early may misfit, and is not trusted then
  const Outcome outcome = estimate(a, pair().pre, pair().post);
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  EXPECT_EQ(outcome.stages,
            (std::vector<v1::EstimateStage>{v1::ESTIMATE_STAGE_RECEIVED, v1::ESTIMATE_STAGE_DISPLACEMENT,
                                            v1::ESTIMATE_STAGE_STRAIN, v1::ESTIMATE_STAGE_MODULUS,
                                            v1::ESTIMATE_STAGE_PUBLISHED}));
  ASSERT_EQ(outcome.maps.size(), 15U);
  for (const v1::Map& map : outcome.maps) {
    const std::size_t item = map.values().dtype() == v1::DATA_TYPE_UINT8 ? 1 : 4;
    EXPECT_EQ(map.values().data().size(), item * map.grid().size(0) * map.grid().size(1)) << map.name();
  }
  EXPECT_EQ(outcome.maps.back().name(), "b_mode");
  const std::string& grey = outcome.maps.back().values().data();
  EXPECT_EQ(std::uint8_t(*std::ranges::max_element(grey, {}, [](char c) { return std::uint8_t(c); })), 255);
  const v1::EstimateSummary& s = outcome.summary;
  EXPECT_TRUE(s.modulus_absolute());
  EXPECT_NEAR(s.mean_axial_strain(), kStrain, 0.05 * -kStrain);
  EXPECT_GT(s.valid_fraction(), 0.8);
  EXPECT_EQ(s.scene_id(), "scene");
  EXPECT_GT(s.received_to_published_s(), 0);
  EXPECT_LT(s.received_to_published_s(), 60);
  const v1::Scene now = scene();
  ASSERT_EQ(now.windows_size(), 1);
  EXPECT_EQ(now.windows(0).window_id(), s.window_id());
  EXPECT_EQ(now.version(), s.scene_version());
  EXPECT_NEAR(now.windows(0).covers().begin_x_m(), 0.04, 1e-9);
  Toucher toucher(channel, "scene");
  ASSERT_TRUE(toucher.opened());
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.002, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK) << answer.warning();
  EXPECT_EQ(answer.model_version(), s.scene_version());
  EXPECT_NEAR(answer.covered().begin_x_m(), 0.04, 1e-9);
  EXPECT_LT(answer.force_n(1), 0);
}

// Of a solid: what it was taken for is told in words (this one strains evenly, and not to the sides), and the
// force sets the scale.
TEST_F(Estimates, OfASolidSayWhatWasAssumed) {
  v1::Acquisition a = acquisition();
  a.set_plane(v1::PLANE_CONDITION_SOLID);
  a.set_tissue_depth_m(0.02);
  a.set_probe_elevation_m(0.010);
  const auto background_pa = [&](double force_n) {
    a.mutable_probe_force()->set_force_n(force_n);
    const Outcome outcome = estimate(a, pair().pre, pair().post);
    EXPECT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    EXPECT_EQ(outcome.stages.size(), 4u);
    const v1::EstimateSummary& s = outcome.summary;
    EXPECT_EQ(s.modulus_method(), v1::MODULUS_METHOD_SOLID);
    EXPECT_TRUE(s.modulus_absolute());
    EXPECT_NE(s.modulus_model().find("a block as wide as the probe"), std::string::npos) << s.modulus_model();
    EXPECT_TRUE(std::ranges::any_of(
        s.warnings(), [](const std::string& warning) { return warning.starts_with("out-of-plane: "); }));
    return s.background_modulus_pa();
  };
  const double one = background_pa(1), two = background_pa(2);
  EXPECT_GT(one, 0);
  EXPECT_NEAR(two / one, 2, 0.02);
}

// The same tissue twice, the second time with a force that cannot be: the summary names it, and claims less.
TEST_F(Estimates, AWrongForceIsNamedInTheSummary) {
  const auto named = [](const Outcome& outcome) {
    for (const std::string& warning : outcome.summary.warnings())
      if (warning.rfind("wrong-force: ", 0) == 0) return true;
    return false;
  };
  v1::Acquisition a = acquisition("scene", 0.04);
  a.set_modulus_time_limit_s(20);  // settled, on the busiest machine too
  EXPECT_FALSE(named(estimate(a, pair().pre, pair().post)));
  EXPECT_FALSE(named(estimate(a, pair().pre, pair().post)));
  a.mutable_probe_force()->set_force_n(1.5 * a.probe_force().force_n());
  const Outcome wrong = estimate(a, pair().pre, pair().post);
  ASSERT_TRUE(wrong.status.ok()) << wrong.status.error_message();
  EXPECT_TRUE(named(wrong));
  // It stays with the window, and a touch there is not to be trusted.
  const v1::WindowEvidence evidence = scene().windows(0).evidence();
  EXPECT_TRUE(std::equal(evidence.warnings().begin(), evidence.warnings().end(),
                         wrong.summary.warnings().begin(), wrong.summary.warnings().end()));
  Toucher toucher(channel, "scene");
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_DEGRADED);
  EXPECT_NE(answer.warning().find("wrong-force"), std::string::npos) << answer.warning();
  const auto& flags = answer.window_flags();
  EXPECT_NE(std::find(flags.begin(), flags.end(), "wrong-force"), flags.end());
  EXPECT_NE(std::find(flags.begin(), flags.end(), "lone"), flags.end());
}

TEST_F(Estimates, AWindowShowsWhatItWasMadeOf) {
  v1::Acquisition a = acquisition("scene", 0.04);
  const double force_n = a.probe_force().force_n();
  a.mutable_probe_force()->set_force_std_n(0.1 * force_n);
  a.mutable_probe_force()->set_force_zero_std_n(0.2 * force_n);
  a.mutable_probe_force()->set_force_gain_std(0.3);
  const Outcome outcome = estimate(a, pair().pre, pair().post);
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  const auto now_ns = [] { return std::chrono::steady_clock::now().time_since_epoch().count(); };
  const std::int64_t published_before_ns = now_ns();
  const v1::WindowEvidence e = scene().windows(0).evidence();
  EXPECT_NEAR(e.force_relative_std(), std::hypot(0.1, 0.2, 0.3), 1e-12);
  EXPECT_NEAR(e.contact_area_relative_std(), 0.05, 1e-12);
  const double common = e.youngs_modulus_common_log_std();
  EXPECT_GT(common, std::hypot(e.force_relative_std(), 0.05));
  EXPECT_LT(common, e.force_relative_std() + 0.05);
  EXPECT_EQ(common, outcome.summary.youngs_modulus_common_log_std());
  EXPECT_EQ(e.background_modulus_pa(), outcome.summary.background_modulus_pa());
  EXPECT_EQ(e.quality(), outcome.summary.quality());
  EXPECT_GT(e.youngs_modulus_log_std(), common);
  EXPECT_NEAR(e.youngs_modulus_log_std(), outcome.summary.youngs_modulus_log_std(), 0.08);
  EXPECT_GT(e.youngs_modulus_correlation_m(), 1e-4);
  EXPECT_EQ(e.youngs_modulus_correlation_m(), outcome.summary.youngs_modulus_correlation_m());
  EXPECT_GT(e.measured_share(), 0.5);
  EXPECT_LE(e.measured_share(), 1);
  // Taken in with the last byte: the whole estimate ago.
  const double ago_s = 1e-9 * static_cast<double>(published_before_ns - e.taken_in().monotonic_ns());
  EXPECT_GE(ago_s, outcome.summary.received_to_published_s());
  Toucher toucher(channel, "scene");
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
  EXPECT_EQ(answer.youngs_modulus_log_std(), e.youngs_modulus_log_std()) << "the force's, once";
  EXPECT_EQ(answer.model_stamp().monotonic_ns(), e.taken_in().monotonic_ns());
  EXPECT_EQ(answer.model_stamp().instance(), e.taken_in().instance());
}

TEST_F(Estimates, WindowHalfAMillimetreOutsideIsEstimated) {
  const Outcome outcome = estimate(acquisition("scene", -0.0005), pair().pre, pair().post);
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  EXPECT_EQ(scene().windows(0).covers().begin_x_m(), 0);
  EXPECT_GT(outcome.summary.background_modulus_pa(), 0);
}

TEST_F(Estimates, MapsAreGivenByNameAndRelativeWithoutAForce) {
  v1::Acquisition a = acquisition();
  a.clear_probe_force();
  a.add_maps("youngs_modulus");
  const Outcome outcome = estimate(a, pair().pre, pair().post);
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  ASSERT_EQ(outcome.maps.size(), 1U);
  EXPECT_EQ(outcome.maps[0].unit(), "1");
  EXPECT_FALSE(outcome.summary.modulus_absolute());
  EXPECT_EQ(outcome.summary.background_modulus_pa(), 1);
}

TEST(FrameUpload, SixteenBitSamplesKeepTheirSign) {
  EstimateRequest request;
  request.sample_count = 4, request.line_count = 1;
  const std::int16_t samples[] = {-32768, -1, 0, 32767};
  FrameUpload upload(request, v1::DATA_TYPE_INT16, sizeof(samples));
  for (const auto kind : {v1::FRAME_KIND_PRE, v1::FRAME_KIND_POST}) {
    v1::FrameChunk chunk;
    chunk.set_frame(kind);
    chunk.set_data(samples, sizeof(samples));
    upload.add(chunk);
  }
  const auto [pre, post] = upload.finish();
  EXPECT_EQ(pre.samples, (std::vector<float>{-32768, -1, 0, 32767}));
  EXPECT_EQ(post.samples, pre.samples);
}

TEST_F(Estimates, SixteenBitFramesAreRead) {
  v1::Acquisition a = acquisition();
  a.set_dtype(v1::DATA_TYPE_INT16);
  const auto narrowed = [](const std::string& bytes) {
    std::vector<float> wide(bytes.size() / sizeof(float));
    std::memcpy(wide.data(), bytes.data(), bytes.size());
    std::vector<std::int16_t> narrow;
    for (const float v : wide) narrow.push_back(static_cast<std::int16_t>(std::lround(10 * v)));
    return std::string(reinterpret_cast<const char*>(narrow.data()), 2 * narrow.size());
  };
  const Outcome outcome = estimate(a, narrowed(pair().pre), narrowed(pair().post));
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  EXPECT_NEAR(outcome.summary.mean_axial_strain(), kStrain, 0.05 * -kStrain);
}

TEST_F(Estimates, TouchGoesOnWhileEstimatesRun) {
  Bystander bystander(server->channel(), "s");
  const auto begun = std::chrono::steady_clock::now();
  for (int k = 0; k < 12; ++k)
    EXPECT_TRUE(estimate(acquisition("scene", 0.02 * (k % 4)), pair().pre, pair().post).status.ok());
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  RecordProperty("answers_per_s", std::to_string(static_cast<double>(bystander.answers()) / took.count()));
  for (const double q : {0.5, 0.99, 1.0})
    RecordProperty("latency_ms_q" + std::to_string(static_cast<int>(100 * q)),
                   std::to_string(1e3 * bystander.latency_s(q)));
  // The promise, p99 < 10 ms, is measured by the bench on a quiet machine; here it may be shared.
  EXPECT_LE(bystander.latency_s(0.99), 0.1);
}

}  // namespace
}  // namespace teletact::service
