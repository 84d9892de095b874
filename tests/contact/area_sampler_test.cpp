// What laws over an area claim, and in what order they come; of a model whose energy is written down here.
#include "service/contact/area_sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include "service/device/device.h"

namespace teletact::service {
namespace {

constexpr Region kRegion{0, 0.03, RangeZ{-0.012, 0.012}};
constexpr Vector3 kNear{0.01, 0, 0.004};

// U = k d^2.4, k = 50 (1 + bumps sin(x / 10 mm) cos(z / 8 mm)); a guess of it is `guessed` times that.
struct Written final : TouchedLayer {
  using At = std::function<bool(double x_m, double z_m, double d_m)>;
  At throws = [](double, double, double) { return false; }, is_nan = throws;
  std::function<bool(double x_m)> fails_to_correct = [](double) { return false; };
  double bumps = 0.1, guessed = 1.03, stated = 0.05, touches_from_m = 0;
  bool loses_device = false;
  mutable Vector3 corrected_at{1e9, 0, 0};

  std::optional<TouchJob> wanted(const Fingertip&, const TouchPose& pose, double) override {
    return TouchJob{stated, JobWait::kFirst, [this, pose](Clock::time_point) {
                      if (loses_device) throw DeviceError("lost");
                      if (fails_to_correct(pose.position_m[0]))
                        throw std::runtime_error("the device is lost");
                      corrected_at = pose.position_m;
                      return true;
                    }};
  }
  ContactAnswer answer(const Fingertip&, const TouchPose& pose) override {
    const auto [x, d, z] = pose.position_m;
    if (throws(x, z, d)) throw std::out_of_range("here it cannot be touched");
    if (d < touches_from_m) return {};
    constexpr double kX = 0.01, kZ = 0.008;
    const double k = 1 + bumps * std::sin(x / kX) * std::cos(z / kZ),
                 by_x = bumps / kX * std::cos(x / kX) * std::cos(z / kZ),
                 by_z = -bumps / kZ * std::sin(x / kX) * std::sin(z / kZ),
                 by_xz = -bumps / kX / kZ * std::cos(x / kX) * std::sin(z / kZ);
    const bool corrected = corrected_at == pose.position_m;
    const double u = 50 * std::pow(d, 2.4) * (corrected ? 1 : guessed);
    ContactAnswer a;
    a.solve.relative_error = corrected ? 1e-3 : stated;
    a.energy_j = u * k;
    a.force_n = {-u * by_x, -2.4 * u / d * k, -u * by_z};
    if (is_nan(x, z, d)) a.force_n.fill(std::numeric_limits<double>::quiet_NaN());
    a.tangent_n_m[1] = -2.4 * u / d * by_x;
    a.tangent_n_m[2] = -u * by_xz;
    a.tangent_n_m[5] = -2.4 * u / d * by_z;
    return a;
  }
};

class Area : public testing::Test {
 protected:
  void sample(const Region& region = kRegion, const Fingertip& tip = {}) {
    sampler = std::make_unique<AreaSampler>(model, Layer{}, tip, region, kNear);
  }
  void guess() {
    while (!sampler->guessed()) sampler->advance(LawSampling::Clock::now());
  }
  void finish() { EXPECT_TRUE(sampler->advance(LawSampling::Clock::time_point::max())); }
  // Off by, over what is stated.
  double off(const std::vector<LawColumn>& columns, double x, double d, double z) {
    const LawValue value = evaluate(columns, x, d, z);
    EXPECT_TRUE(value.covered) << x << " " << z;
    model->corrected_at = {x, d, z};
    const ContactAnswer truth = model->answer({}, {{x, d, z}});
    return std::hypot(value.by_x_n + truth.force_n[0], value.by_d_n + truth.force_n[1],
                      value.by_z_n + truth.force_n[2]) /
           value.error_n;
  }
  double worst(const std::vector<LawColumn>& columns) {
    double most = 0;
    for (double x = 0; x < 0.03; x += 7e-4)
      for (double z = -0.012; z < 0.012; z += 9e-4)
        for (const double d : {4e-4, 1.2e-3, 5e-3}) most = std::max(most, off(columns, x, d, z));
    return most;
  }
  std::shared_ptr<Written> model = std::make_shared<Written>();
  std::unique_ptr<AreaSampler> sampler;
};

TEST_F(Area, IsGuessedThenCorrectedAndStatesWhatEitherIsOffBy) {
  sample();
  guess();
  const auto guesses = sampler->columns();
  for (const LawColumn& column : guesses) EXPECT_FALSE(column.corrected);
  const double first = worst(guesses);
  EXPECT_LT(first, 1);
  EXPECT_GT(first, 0.3) << "3 % of 5 % that were stated";
  finish();
  const auto columns = sampler->columns();
  ASSERT_EQ(columns.size(), guesses.size());
  for (std::size_t i = 0; i < columns.size(); ++i) {
    EXPECT_TRUE(columns[i].corrected);
    EXPECT_LT(columns[i].error_share, 0.02) << "and the guess said " << guesses[i].error_share;
    EXPECT_GT(guesses[i].error_share, 0.05);
  }
  EXPECT_LT(worst(columns), 1);
}

TEST_F(Area, ComesFromTheFingerOutwards) {
  sample();
  std::vector<LawColumn> shown;
  while (shown.empty()) {
    sampler->advance(LawSampling::Clock::now());
    shown = sampler->columns();
  }
  const auto away = [](const LawColumn& c) { return std::hypot(c.x_m - kNear[0], c.z_m - kNear[2]); };
  for (const LawColumn& column : shown) EXPECT_LT(away(column), 0.015);
  guess();
  std::vector<LawColumn> corrected;
  while (corrected.empty()) {
    ASSERT_FALSE(sampler->advance(LawSampling::Clock::now()));
    corrected = sampler->columns();
    std::erase_if(corrected, [](const LawColumn& c) { return !c.corrected; });
  }
  for (const LawColumn& column : corrected) EXPECT_LT(away(column), 0.015);
  EXPECT_LT(corrected.size(), sampler->columns().size() / 2);
}

// Others wait for their turn that long.
TEST_F(Area, AStepIsAContactOrThoseOfOneCell) {
  sample();
  for (bool done = false; !done;) {
    const std::size_t before = sampler->solves();
    done = sampler->advance(LawSampling::Clock::now());
    EXPECT_LE(sampler->solves() - before, 2U);
  }
}

TEST_F(Area, WhatIsCorrectedIsNotAlteredAnyMore) {
  sample();
  std::map<std::pair<double, double>, LawColumn> known;
  for (bool done = false; !done;) {
    done = sampler->advance(LawSampling::Clock::now());
    for (const LawColumn& column : sampler->columns()) {
      if (!column.corrected) continue;
      const auto [at, fresh] = known.try_emplace({column.z_m, column.x_m}, column);
      EXPECT_EQ(at->second.error_share, column.error_share);
      EXPECT_EQ(at->second.samples[2].log_energy, column.samples[2].log_energy);
    }
  }
  EXPECT_EQ(known.size(), sampler->columns().size());
}

TEST_F(Area, EndsAboveWhatCannotBeTouchedAndIsMissingWhereNothingCan) {
  model->throws = [](double, double, double d) { return d > 5e-3; };
  sample();
  finish();
  for (const LawColumn& column : sampler->columns()) EXPECT_EQ(column.rows, 3);
  EXPECT_TRUE(evaluate(sampler->columns(), 0.01, 4e-3, 0).beyond);
  model->throws = [](double x, double z, double) { return x > 0.02 && z > 0; };
  sample();
  finish();
  const auto columns = sampler->columns();
  EXPECT_FALSE(evaluate(columns, 0.026, 2e-3, 0.006).covered);
  EXPECT_TRUE(evaluate(columns, 0.008, 2e-3, 0.006).covered);
  EXPECT_TRUE(evaluate(columns, 0.026, 2e-3, -0.009).covered);
}

TEST_F(Area, ClaimsNothingWhereNothingCouldBeTried) {
  for (const auto fails : {&Written::throws, &Written::is_nan}) {
    model = std::make_shared<Written>();
    (*model).*fails = [](double x, double z, double) {  // amid its cells
      return x > 0.0125 && x < 0.0245 && std::abs(z) < 0.006 && std::fmod(x, 0.00618) > 1e-6 &&
             0.00618 - std::fmod(x, 0.00618) > 1e-6;
    };
    sample();
    guess();
    const LawValue amid = evaluate(sampler->columns(), 0.0155, 2e-3, 0.001);
    ASSERT_TRUE(amid.covered);
    EXPECT_GE(amid.error_n, std::hypot(amid.by_x_n, amid.by_d_n, amid.by_z_n));
  }
}

TEST_F(Area, WhatCannotBeCorrectedStaysAGuessAndSaysSo) {
  model->fails_to_correct = [](double x) { return x > 0.015; };
  sample();
  finish();
  std::size_t guesses = 0;
  for (const LawColumn& column : sampler->columns()) {
    EXPECT_TRUE(column.corrected || column.x_m > 0.01);
    guesses += !column.corrected;
    if (!column.corrected) {
      EXPECT_GT(column.error_share, 0.05);
    }
  }
  EXPECT_GT(guesses, 0U);
  EXPECT_LT(worst(sampler->columns()), 1);
}

TEST_F(Area, ADeviceThatFailsEndsTheSampling) {
  model->loses_device = true;
  sample();
  EXPECT_THROW(
      {
        while (!sampler->advance(LawSampling::Clock::now())) {
        }
      },
      DeviceError);
}

TEST_F(Area, ATipThatIsAboveTheNodesStillHasItsDeeperRows) {
  model->touches_from_m = 5e-4;
  sample();
  finish();
  ASSERT_FALSE(sampler->columns().empty());
  for (const LawColumn& column : sampler->columns()) {
    EXPECT_EQ(column.rows, 3);
    EXPECT_NEAR(std::exp(column.log_depth[0]), 9e-4, 1e-6);
  }
}

TEST_F(Area, TooWideATissueHasNone) {
  sample({0, 0.3, RangeZ{0, 0.3}});
  finish();
  EXPECT_TRUE(sampler->columns().empty());
  EXPECT_EQ(sampler->solves(), 0U);
}

}  // namespace
}  // namespace teletact::service
