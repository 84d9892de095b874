// The variance that is reported is what the rendered stiffness is off by: standardised errors near 1 over
// many draws of tissue that changes as the walk says, at every age of the answer behind it and of both
// components.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "client/render/kalman_renderer.h"
#include "client/render/renderers.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

constexpr double kTickS = 0.001, kSpeedMS = 0.12, kDepthM = 0.004;
constexpr int kEvery = 10, kAge = 4, kLast = 200, kLate = 60;  // ticks

// What the finger meets on its way along x: for each component, [lateral, push, second lateral], a stationary
// process whose increments are those of a walk of `walk_n_m` per square root of a second at first, and which
// forgets over the correlation length; on it a slope that the tangent tells.
struct Drawn {
  double walk_n_m, noise_n, tangent_noise_n_m, slope_n_m2;
  Vector3 mean_n_m;
};

class Tissue {
 public:
  Tissue(const Drawn& drawn, unsigned seed) : drawn_(drawn), random_(seed) {
    const double forgets_s = kCorrelationM / kWalkSpeedMS;
    sigma_n_m_ = drawn.walk_n_m * std::sqrt(forgets_s / 2);
    keeps_ = std::exp(-kTickS / forgets_s);
    for (Vector3* k : {&process_, &slope_}) *k = drawn_vector();
    process_ *= sigma_n_m_;
    slope_ *= drawn.slope_n_m2;
  }
  void step() {
    process_ = keeps_ * process_ + sigma_n_m_ * std::sqrt(1 - keeps_ * keeps_) * drawn_vector();
    x_m_ += kSpeedMS * kTickS;
    time_s_ += kTickS;
  }
  Vector3 stiffness_n_m() const { return drawn_.mean_n_m + process_ + slope_ * x_m_; }
  ToolPose pose() const { return {Vector3(x_m_, kDepthM, 0), Vector3(kSpeedMS, 0, 0)}; }
  double time_s() const { return time_s_; }
  ForceSample answer() {
    ForceSample sample;
    sample.contact = true;
    sample.pose_time_s = time_s_;
    sample.position_m = pose().position_m;
    const auto noise = [&](double sigma) -> Vector3 { return sigma * drawn_vector(); };
    sample.force_n = -kDepthM * stiffness_n_m() + noise(drawn_.noise_n);
    sample.tangent_n_m.col(1) = -stiffness_n_m() + noise(drawn_.tangent_noise_n_m);
    sample.tangent_n_m.col(0) = -kDepthM * slope_ + noise(drawn_.tangent_noise_n_m);
    sample.tangent_n_m.col(2) = noise(drawn_.tangent_noise_n_m);
    return sample;
  }

 private:
  Vector3 drawn_vector() {
    const double lateral = normal_(random_), push = normal_(random_);
    return {lateral, push, normal_(random_)};
  }

  Drawn drawn_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  double sigma_n_m_, keeps_;
  Vector3 process_, slope_;
  double x_m_ = 0, time_s_ = 0;
};

Vector3 stiffness_of(const Rendered& felt) {
  return {felt.lateral_stiffness_n_m.x(), felt.stiffness_n_m, felt.lateral_stiffness_n_m.y()};
}

Vector3 variance_of(const Rendered& felt) {
  return {felt.lateral_variance.x(), felt.variance, felt.lateral_variance.y()};
}

struct Standardised {
  Vector3 squares = Vector3::Zero();
  int count = 0;
  void add(const Rendered& felt, const Vector3& truth_n_m) {
    const Vector3 error = stiffness_of(felt) - truth_n_m;
    squares += error.cwiseAbs2().cwiseQuotient(variance_of(felt));
    ++count;
  }
  Vector3 rms() const { return (squares / count).cwiseSqrt(); }
};

constexpr std::array<const char*, 4> kWhen{"as an answer comes", "after it", "halfway", "late"};

// Answers every 10 ms, 4 ms old as they come, for .2 s; then none. Fresh tissue in every draw.
template <typename Make>
std::array<Standardised, 4> standardised(const Drawn& drawn, const Make& make) {
  std::array<Standardised, 4> errors;
  for (unsigned draw = 0; draw < 3000; ++draw) {
    const auto renderer = make();
    Tissue tissue(drawn, draw + 1);
    ForceSample coming;
    for (int tick = 0; tick <= kLast + kLate; ++tick, tissue.step()) {
      if (tick % kEvery == 0) coming = tissue.answer();
      const int age = tick % kEvery;
      if (age == kAge && tick < kLast + kEvery) renderer->update(coming, tissue.pose(), tissue.time_s());
      const Rendered felt = renderer->render(tissue.pose(), tissue.time_s());
      const int since = tick - kLast - kAge;
      if (since == 0) errors[0].add(felt, tissue.stiffness_n_m());
      if (since == 1) errors[1].add(felt, tissue.stiffness_n_m());
      if (since == kEvery / 2) errors[2].add(felt, tissue.stiffness_n_m());
      if (tick == kLast + kLate) errors[3].add(felt, tissue.stiffness_n_m());
    }
  }
  return errors;
}

void expect_honest(const std::string& name, const std::array<Standardised, 4>& errors) {
  for (std::size_t n = 0; n < errors.size(); ++n) {
    const Vector3 rms = errors[n].rms();
    std::printf("%s, %s: standardised error lateral %.3f, push %.3f, second lateral %.3f\n", name.c_str(),
                kWhen[n], rms.x(), rms.y(), rms.z());
    for (const double one : rms) {
      EXPECT_GE(one, 0.8) << name << ' ' << kWhen[n];
      EXPECT_LE(one, 1.25) << name << ' ' << kWhen[n];
    }
  }
}

KalmanOptions told_of(const Drawn& drawn, bool use_tangent) {
  KalmanOptions options;
  options.use_tangent = use_tangent;
  options.stiffness_walk_share = 0;
  options.stiffness_walk_n_m = drawn.walk_n_m;
  options.force_noise_share = options.tangent_noise_share = 0;
  options.force_noise_n = drawn.noise_n;
  options.tangent_noise_n_m = drawn.tangent_noise_n_m;
  return options;
}

TEST(Variance, OfTheKalmanFilterIsWhatItsStiffnessIsOffBy) {
  // GIVEN a walk that is small beside the stiffness, and one that takes several servo periods to be blended
  // in
  for (const Drawn& drawn :
       {Drawn{100, 0.02, 2, 500, {40, 300, -20}}, Drawn{1000, 0.02, 2, 500, {40, 600, -20}}}) {
    for (const bool tangent : {false, true}) {
      const KalmanOptions options = told_of(drawn, tangent);
      const auto errors = standardised(drawn, [&] { return std::make_unique<KalmanRenderer>(options); });
      expect_honest("kalman" + std::string(tangent ? "" : "-force"), errors);
    }
  }
}

TEST(Variance, OnSmoothTissueIsNeverTooSmallNorWiderThanItsModelIs) {
  // GIVEN three inclusions (not as the walk says: the slope tells more of them than of a walk)
  for (const std::string& name : renderer_names()) {
    const auto renderer = make_renderer(name, kTickS);
    const test::AnalyticTissue tissue;
    Standardised errors;
    ForceSample coming;
    for (int tick = 0; tick < 900; ++tick) {
      const double time_s = kTickS * tick;
      const ToolPose pose{{0.01 + kSpeedMS * time_s, kDepthM, 0}, {kSpeedMS, 0, 0}};
      if (tick % kEvery == 0) coming = tissue.answer(pose.position_m, time_s);
      if (tick % kEvery == kAge) renderer->update(coming, pose, time_s);
      const Rendered felt = renderer->render(pose, time_s);
      if (tick >= 100) errors.add(felt, -tissue.answer(pose.position_m).force_n / kDepthM);
    }
    std::printf("%s: standardised error lateral %.3f, push %.3f\n", name.c_str(), errors.rms().x(),
                errors.rms().y());
    EXPECT_LE(errors.rms().maxCoeff(), 1.25) << name;
    EXPECT_GE((errors.rms().head<2>() - Vector2(0.009, 0.02)).minCoeff(), 0)
        << name;  // the tangent tells nearly all
  }
}

ForceSample pressed(const Vector3& force_n, double time_s) {
  ForceSample sample;
  sample.contact = true;
  sample.pose_time_s = time_s;
  sample.position_m = {0, kDepthM, 0};
  sample.force_n = force_n;
  sample.tangent_n_m(1, 1) = force_n.y() / kDepthM;
  return sample;
}

const ToolPose kTool{{0, kDepthM, 0}, Vector3::Zero()};

TEST(Variance, IsInfiniteWhileNothingIsKnown) {
  for (const std::string& name : renderer_names()) {
    const auto renderer = make_renderer(name, kTickS);
    const auto expect_unknown = [&](double time_s) {
      const Rendered felt = renderer->render(kTool, time_s);
      EXPECT_EQ(variance_of(felt).minCoeff(), std::numeric_limits<double>::infinity()) << name;
    };
    expect_unknown(0);
    // WHEN one answer came THEN it is finite and no certainty; WHEN nothing is covered THEN nothing is known
    renderer->update(pressed({0, -1, 0}, 0), kTool, 0.004);
    const Rendered felt = renderer->render(kTool, 0.004);
    EXPECT_GT(variance_of(felt).minCoeff(), 1) << name;
    EXPECT_TRUE(variance_of(felt).allFinite()) << name;
    ForceSample none;
    none.position_m = kTool.position_m;
    none.pose_time_s = 0.01;
    renderer->update(none, kTool, 0.014);
    expect_unknown(0.014);
    renderer->update(pressed({0, -1, 0}, 0.02), kTool, 0.024);
    renderer->reset();
    expect_unknown(0.03);
  }
}

TEST(Variance, GrowsWithTimeAndWithTheWayAndComesToAnEnd) {
  for (const std::string& name : renderer_names()) {
    const auto renderer = make_renderer(name, kTickS);
    double time_s = 0;
    for (int n = 0; n < 50; ++n, time_s += 0.01)
      renderer->update(pressed(Vector3(0.1, -1, 0.05) + 0.01 * (n % 2) * Vector3(1, -2, 1), time_s), kTool,
                       time_s);
    const auto at = [&](double later_s, double way_m) {
      renderer->render({{way_m, kDepthM, 0}, Vector3::Zero()}, 1000);  // all is blended in
      return variance_of(renderer->render({{way_m, kDepthM, 0}, Vector3::Zero()}, time_s - 0.01 + later_s));
    };
    Vector3 last = at(0.01, 0);
    for (const double later_s : {0.011, 0.015, 0.02, 0.04, 0.1}) {
      EXPECT_GT((at(later_s, 0) - last).minCoeff(), 0) << name << ' ' << later_s;
      last = at(later_s, 0);
    }
    last = at(0.01, 0);
    for (const double way_m : {0.002, 0.004, 0.008, 0.016}) {
      EXPECT_GT((at(0.01, way_m) - last).minCoeff(), 0) << name << ' ' << way_m;
      last = at(0.01, way_m);
    }
    // 60 s later and 200 mm away a good part of the stiffness may have changed, but not more than that
    const Vector3 far = at(60, 0.2);
    const double stiffness_n_m = 1 / kDepthM;
    EXPECT_GT(std::sqrt(far.minCoeff()), 0.3 * stiffness_n_m) << name;
    EXPECT_LT(std::sqrt(far.maxCoeff()), 1.0 * stiffness_n_m) << name;
  }
}

}  // namespace
}  // namespace teletact::client
