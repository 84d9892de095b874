// Shares of a contact's force against those of finite elements: eight nodes, axisymmetric, made elsewhere.
#include "service/scene/felt_elements.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numeric>

namespace teletact::service {
namespace {

std::vector<double> nodes(double begin_m, double end_m, std::size_t count) {
  std::vector<double> out;
  for (std::size_t n = 0; n <= count; ++n)
    out.push_back(begin_m + (end_m - begin_m) * static_cast<double>(n) / static_cast<double>(count));
  return out;
}

struct Shares {
  double all = 0;
  std::vector<double> within_depth, within_side;
};

Shares shares_of(const FeltPlace& place, const std::vector<double>& depths_m, double from_m, double to_m,
                 const std::vector<double>& sides_m) {
  constexpr std::size_t kColumns = 240, kRows = 160;
  const std::vector<double> x = nodes(0, 0.06, kColumns), y = nodes(0, 0.04, kRows);
  Shares out{0, std::vector<double>(depths_m.size()), std::vector<double>(sides_m.size())};
  double band = 0;
  FeltElements(x, y, place).each([&](std::size_t n, double share) {
    const double at_x = (x[n % kColumns] + x[n % kColumns + 1]) / 2 - place.x_m,
                 at_y = (y[n / kColumns] + y[n / kColumns + 1]) / 2;
    EXPECT_GT(share, 0);
    out.all += share;
    for (std::size_t k = 0; k < depths_m.size(); ++k)
      if (at_y < depths_m[k]) out.within_depth[k] += share;
    if (at_y < from_m || at_y > to_m) return;
    band += share;
    for (std::size_t k = 0; k < sides_m.size(); ++k)
      if (std::abs(at_x) < sides_m[k]) out.within_side[k] += share;
  });
  for (double& side : out.within_side) side /= band;
  return out;
}

TEST(FeltElements, AreThoseOfFiniteElements) {
  struct Case {
    double radius_m;
    std::vector<double> within_depth;  // of radii 1/4, 1/2, 1, 2, 4
  };
  const std::array cases{
      Case{0.001, {0.034, 0.121, 0.327, 0.606, 0.799}}, Case{0.0028, {0.036, 0.128, 0.346, 0.640, 0.844}},
      Case{0.00566, {0.041, 0.142, 0.382, 0.710, 0.922}}, Case{0.010, {0.051, 0.171, 0.448, 0.793, 1.000}}};
  for (const Case& c : cases) {
    std::vector<double> depths;
    for (const double k : {0.25, 0.5, 1.0, 2.0, 4.0}) depths.push_back(k * c.radius_m);
    const Shares at = shares_of({0.03, 0, 0, c.radius_m}, depths, 0, 1, {});
    EXPECT_NEAR(at.all, 1, 1e-9);
    for (std::size_t k = 0; k < depths.size(); ++k)
      EXPECT_NEAR(at.within_depth[k], c.within_depth[k], 0.06) << c.radius_m << " " << depths[k];
  }
  // Beside its middle: within half a radius, one, two and four, between these depths in radii.
  constexpr double kA = 0.0028;
  const auto sides = [&](double from, double to) {
    return shares_of({0.03, 0, 0, kA}, {}, from * kA, to * kA, {kA / 2, kA, 2 * kA, 4 * kA}).within_side;
  };
  const auto near = [](const std::vector<double>& found, const std::array<double, 4>& told) {
    for (std::size_t k = 0; k < told.size(); ++k) EXPECT_NEAR(found[k], told[k], 0.12) << k;
  };
  near(sides(0.5, 1), {0.43, 0.77, 0.97, 1});
  near(sides(1, 2), {0.36, 0.65, 0.91, 0.99});
  near(sides(2, 4), {0.24, 0.46, 0.75, 0.94});
  near(sides(4, 8), {0.15, 0.28, 0.52, 0.80});
}

// At the tissue's end what would be borne beyond is borne by the last elements; inside, both ways.
TEST(FeltElements, AllIsBorneWhereverTheContactIs) {
  for (const double x_m : {-0.01, 0.0, 0.0301, 0.06})
    for (const double depth_m : {0.0, 0.0101, 0.0399})
      EXPECT_NEAR(shares_of({x_m, depth_m, 0, 0.003}, {}, 0, 1, {}).all, 1, 1e-9) << x_m << " " << depth_m;
  const Shares inside = shares_of({0.03, 0.02, 0, 0.003}, {0.02}, 0, 1, {});
  EXPECT_NEAR(inside.within_depth[0], 0.5, 1e-9);
}

// A contact is round: what lies to one side across the plane is what lies to that side in it.
TEST(FeltElements, ReachAsFarAcrossThePlaneAsInIt) {
  constexpr std::size_t kColumns = 400, kRows = 8;
  const std::vector<double> x = nodes(-0.2, 0.2, kColumns), y = nodes(0, 0.04, kRows);
  const FeltElements felt(x, y, {0, 0, 0.007, 0.004});
  std::vector<double> rows(kRows, 0.0), before = rows;
  felt.each([&](std::size_t n, double share) { rows[n / kColumns] += share; });
  felt.each([&](std::size_t n, double share) {
    const std::size_t j = n / kColumns;
    before[j] += share / rows[j];
    const double end_m = x[n % kColumns + 1];
    if (std::abs(end_m) > 0.03) return;  // the outermost bear what is beyond
    EXPECT_NEAR(felt.before(j, 0.007 + end_m), before[j], 1e-6) << j << ' ' << end_m;
  });
  for (std::size_t j = 0; j < kRows; ++j) {
    EXPECT_NEAR(felt.before(j, HUGE_VAL), 1, 1e-15);
    EXPECT_NEAR(felt.before(j, -HUGE_VAL), 0, 1e-15);
    // By parts: the moment is what the share is times the way, less the shares summed over the way.
    double sum = 0;
    for (int k = 0; k < 3000; ++k) sum += 1e-5 * felt.before(j, -0.013 + 1e-5 * (k + 0.5));
    EXPECT_NEAR(felt.moment_before(j, 0.017) - felt.moment_before(j, -0.013),
                0.010 * felt.before(j, 0.017) + 0.020 * felt.before(j, -0.013) - sum, 1e-7)
        << j;
  }
}

}  // namespace
}  // namespace teletact::service
