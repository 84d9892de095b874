// The independent truth is right where the answer is known, and echoes arrive when they should.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "bench/independent/plane_waves.h"
#include "bench/independent/pressed_block.h"
#include "bench/independent/touched_block.h"

namespace teletact::bench {
namespace {

constexpr double kFree = std::numeric_limits<double>::quiet_NaN();
constexpr double kModulusPa = 10e3, kPoissonRatio = .49;

double modulus(const Hexahedra::Point&) {
  return kModulusPa;
}

Eigen::Matrix3Xd free_nodes(const Hexahedra& mesh) {
  return Eigen::Matrix3Xd::Constant(3, mesh.size(), kFree);
}

TEST(Hexahedra, UnevenBoxesCarryAnyUniformStrain) {
  const Hexahedra mesh({{{0, .1, .5, 1}, {0, .4, .5, 2}, {-1, .3, 1}}});
  Eigen::Matrix3d gradient;
  gradient << .01, .02, -.01, .03, -.02, .01, .005, .01, .02;
  Eigen::Matrix3Xd prescribed = free_nodes(mesh);
  Eigen::Index inner = 0;
  for (Eigen::Index n = 0; n < mesh.size(); ++n) {
    const auto& p = mesh.node(n);
    const bool border = p.x() == 0 || p.x() == 1 || p.y() == 0 || p.y() == 2 || std::abs(p.z()) == 1;
    if (border)
      prescribed.col(n) = gradient * p;
    else
      ++inner;
  }
  ASSERT_GT(inner, 10);
  const auto solution = mesh.solve(mesh.means(modulus), kPoissonRatio, prescribed);
  for (Eigen::Index n = 0; n < mesh.size(); ++n)
    EXPECT_LT((solution.displacement_m.col(n) - gradient * mesh.node(n)).norm(), 1e-6);
  const Hexahedra::Point between(.07, 1.3, .11);
  EXPECT_LT((mesh.at(between, solution.displacement_m) - gradient * between).norm(), 1e-6);
}

// Free sides, ends that slide: force E A strain, sideways -nu strain.
TEST(Hexahedra, ABarPressedBetweenSlidingPlatesIsExact) {
  const double length_m = .04, width_m = .02, across_m = .01, push_m = .0004;
  const Hexahedra mesh({graded_lines({0, width_m}, [](double) { return .006; }),
                        graded_lines({0, length_m}, [](double y) { return .002 + .3 * y; }),
                        {0, .002, across_m}});
  Eigen::Matrix3Xd prescribed = free_nodes(mesh);
  for (Eigen::Index n = 0; n < mesh.size(); ++n) {
    const auto& p = mesh.node(n);
    if (p.x() == 0) prescribed(0, n) = 0;
    if (p.z() == 0) prescribed(2, n) = 0;
    if (p.y() == 0) prescribed(1, n) = push_m;
    if (p.y() == length_m) prescribed(1, n) = 0;
  }
  const auto solution = mesh.solve(mesh.means(modulus), kPoissonRatio, prescribed);
  double force_n = 0;
  for (Eigen::Index n = 0; n < mesh.size(); ++n)
    if (mesh.node(n).y() == 0) force_n += solution.force_n(1, n);
  const double strain = push_m / length_m;
  EXPECT_NEAR(force_n / (kModulusPa * width_m * across_m * strain), 1, 1e-5);
  EXPECT_NEAR(mesh.at({width_m, .01, .005}, solution.displacement_m).x() / (kPoissonRatio * strain * width_m),
              1, 1e-4);
}

// As the face tilts, what is bonded to it rests in its view, and the bottom comes nearer.
TEST(PressedBlock, MovesAsItsFaceAndItsBottomDo) {
  Block block;
  block.width_m = .016, block.across_m = .012, block.depth_m = .01;
  block.face_width_m = .008, block.face_across_m = .008, block.push_m = .0001, block.tilt = .01;
  const PressedBlock pressed(block);
  for (const double x : {-.003, 0., .001}) {
    EXPECT_LT(pressed.at(x, 0).norm(), 1e-9);
    EXPECT_LT((pressed.at(x, .01) - Eigen::Vector2d(.01 * .01, -.0001 - .01 * x)).norm(), 1e-9);
  }
}

// As wide as its face, which slides: its bonded bottom alone makes it stiffer than a free bar.
TEST(PressedBlock, AColumnIsPressedLikeABar) {
  Block block;
  block.width_m = block.across_m = block.face_width_m = block.face_across_m = .006;
  block.depth_m = .03, block.push_m = .0003, block.bonded_face = false;
  const double force_n = PressedBlock(block).force_n(), bar_n = kModulusPa * .006 * .006 * .01;
  EXPECT_GT(force_n, bar_n);
  EXPECT_LT(force_n, 1.1 * bar_n);
}

// Bonded by Dimitriadis et al. (2002), of thin incompressible layers; sliding by an exact layer.
TEST(RoundTouch, AThinLayerBearsMoreThanAHalfSpaceLessWhereItSlidesOrEnds) {
  constexpr double kAcross = 2;
  RoundTouch touch;
  touch.depth_m = .006, touch.indentation_m = .0005;
  touch.modulus_pa = modulus;
  const double radius_m = std::sqrt(touch.radius_m * touch.indentation_m), x = radius_m / touch.depth_m,
               hertz_n =
                   4. / 3 * kModulusPa / (1 - kPoissonRatio * kPoissonRatio) * radius_m * touch.indentation_m;
  const double held_n = round_touch_n(touch, kAcross);
  EXPECT_NEAR(held_n / hertz_n, 1 + x * (1.133 + x * (1.283 + x * (.769 + x * .0975))), .03);
  RoundTouch sliding = touch, narrow = touch;
  sliding.slides = true, narrow.sides = {-.004, .004, -.004, .004};
  EXPECT_NEAR(round_touch_n(sliding, kAcross) / held_n, .839, .02);
  EXPECT_LT(round_touch_n(narrow, kAcross), .8 * held_n);
  touch.sides.left_m = .001;
  EXPECT_THROW(round_touch_n(touch), std::invalid_argument);
}

class PlaneWavesTest : public testing::Test {
 protected:
  PlaneWavesTest() { waves_.elements = 64, waves_.samples = 600; }
  std::vector<float> rf(Scatterer s, double aberration_s = 0) const {
    const std::vector<double> aberration(waves_.elements, aberration_s);
    return beamformed_rf(waves_, {&s, 1}, aberration);
  }
  // Of one line, at the carrier: sum over the samples near the echo.
  std::complex<double> carrier(const std::vector<float>& lines, std::size_t line) const {
    std::complex<double> sum = 0;
    for (std::size_t k = 0; k < waves_.samples; ++k)
      sum += double(lines[k + waves_.samples * line]) *
             std::polar(1., -2 * std::numbers::pi * waves_.center_frequency_hz * double(k) / 40e6);
    return sum;
  }
  // Depth of an echo, m: centroid of its energy in its line.
  double depth_m(const std::vector<float>& lines, std::size_t line) const {
    double sum = 0, at = 0;
    for (std::size_t k = 0; k < waves_.samples; ++k) {
      const double energy = std::pow(lines[k + waves_.samples * line], 2);
      sum += energy, at += energy * double(k);
    }
    return at / sum * waves_.sample_pitch_m();
  }
  static constexpr std::size_t kLine = 40;
  PlaneWaves waves_;
};

TEST_F(PlaneWavesTest, AnEchoLiesAtItsScatterer) {
  const double x_m = waves_.x_m(kLine);
  const auto lines = rf({x_m, .008});
  const auto largest =
      std::ranges::max_element(lines, {}, [](float v) { return std::abs(v); }) - lines.begin();
  EXPECT_EQ(largest / 600, kLine);
  EXPECT_NEAR(depth_m(lines, kLine), .008, 10e-6);
  // A micrometre deeper is a micrometre of phase.
  const double turned = std::arg(carrier(rf({x_m, .008001}), kLine) / carrier(lines, kLine));
  EXPECT_NEAR(turned / (-4 * std::numbers::pi * waves_.center_frequency_hz / 1540), 1e-6, .05e-6);
}

TEST_F(PlaneWavesTest, FasterSoundAndLateElementsShiftIt) {
  const double x_m = waves_.x_m(kLine);
  waves_.speed_m_s = 1.02 * waves_.stated_speed_m_s;
  EXPECT_NEAR(depth_m(rf({x_m, .00816}), kLine), .008, 20e-6);
  waves_.speed_m_s = waves_.stated_speed_m_s;
  EXPECT_NEAR(depth_m(rf({x_m, .008}, 50e-9), kLine), .008 + 1540 * 50e-9, 10e-6);
}

TEST_F(PlaneWavesTest, AttenuationLowersTheFrequency) {
  const double x_m = waves_.x_m(kLine);
  const auto spectrum_hz = [&] {
    const auto lines = rf({x_m, .010});
    double crossings = 0, first = 0, last = 0;
    for (std::size_t k = 1; k < waves_.samples; ++k) {
      const float a = lines[k - 1 + 600 * kLine], b = lines[k + 600 * kLine];
      if (std::abs(double(k) * waves_.sample_pitch_m() - .010) > .1e-3 || (a < 0) == (b < 0)) continue;
      const double at = double(k) - b / (b - a);
      if (crossings++ == 0) first = at;
      last = at;
    }
    return (crossings - 1) / 2 / (last - first) * 40e6;
  };
  const double without_hz = spectrum_hz();
  EXPECT_NEAR(without_hz, 7e6, 1e6);
  waves_.attenuation_db_cm_mhz = 1;
  EXPECT_LT(spectrum_hz(), .97 * without_hz);
}

TEST_F(PlaneWavesTest, APairIsOfItsSeedAndFillsItsNumbers) {
  waves_.samples = 200, waves_.elements = 16;
  const auto still = [](double, double) { return Eigen::Vector2d::Zero(); };
  const PlaneWavePair a = plane_wave_pair(waves_, still, 1), b = plane_wave_pair(waves_, still, 2);
  EXPECT_EQ(a.pre, a.post);
  EXPECT_NE(a.pre, b.pre);
  EXPECT_GT(*std::ranges::max_element(a.pre), 12000);
}

}  // namespace
}  // namespace teletact::bench
