// The regularised refinement against its reference, and what it promises of uniform strain.
#include "service/imaging/tracking/refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"
#include "tests/reference/regularised.h"

namespace teletact::service {
namespace {

constexpr double kLine = 0.235e-3, kSample = 19.25e-6;
constexpr int kLast = kRefinementSteps - 1;

// A noisy pair, slightly apart, as mean and difference on 211 x 23 samples, with some pixels far off.
class RefinementTest : public ::testing::Test {
 protected:
  RefinementTest() : queue_(imaging_device()->queue()) {
    SpeckleOptions options;
    options.samples = 211;
    options.lines = 23;
    options.snr_db = 25;
    const Speckle speckle(options);
    pre_ = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    const RfFrame post = speckle.frame(
        [](double x, double y) {
          return std::pair{0.01 * x, 2e-6 - 0.001 * y};
        },
        2);
    mean_ = difference_ = pre_;
    for (std::size_t n = 0; n < pre_.samples.size(); ++n) {
      mean_.samples[n] = 0.5f * (pre_.samples[n] + post.samples[n]);
      difference_.samples[n] = pre_.samples[n] - post.samples[n];
    }
    difference_.samples[1500] = 900;
    pad_ = padding(pre_, 48, 10);
    mean_device_ = queue_.array(padded(mean_, pad_));
    difference_device_ = queue_.array(padded(difference_, pad_));
    grid_ = centred_grid(pre_, 2, 21);
  }
  ImagePair images() const { return {mean_device_, difference_device_, pad_.layout, 211, 23}; }
  std::vector<float> field() const {
    std::vector<float> u;
    for (int n = 0; n < grid_.nodes(); ++n) {
      u.push_back(0.02f * static_cast<float>(n % grid_.nx) + 0.1f * std::sin(0.7f * static_cast<float>(n)));
      u.push_back(0.3f - 0.05f * static_cast<float>(n / grid_.nx) +
                  0.05f * std::cos(1.1f * static_cast<float>(n)));
    }
    return u;
  }

  Queue queue_;
  RfFrame pre_, mean_, difference_;
  Padding pad_;
  SampleGrid grid_;
  Array<float> mean_device_, difference_device_;
};

reference::RfImage as_reference(const RfFrame& f) {
  return {
      static_cast<int>(f.sample_count), static_cast<int>(f.line_count), {f.samples.begin(), f.samples.end()}};
}

TEST_F(RefinementTest, StepMatchesTheReference) {
  PcgOptions options = kRefinementSolve;
  options.relative_residual = 1e-6;
  Refinement refinement(queue_, options, grid_, kLine, kSample);
  const auto nodes = static_cast<std::size_t>(grid_.nodes());
  Array<float> out = queue_.array<float>(2 * nodes), correlation = queue_.array<float>(nodes);
  refinement.measure(images(), true, correlation);
  const std::vector<float> start = field();
  refinement.step(queue_.array(start), out, 1e6f, 1e6f, kLast);
  const std::vector<float> m = refinement.model();
  EXPECT_EQ(Refinement::solved(m, kLast).reason, StopReason::kConverged);

  reference::RegularisedModel model;
  model.weight_along = {m[0], m[1]}, model.weight_down = {m[2], m[3]};
  model.spread = {m[4], m[5]}, model.sensitivity = {m[6], m[7]};
  std::vector<reference::Pair> u(nodes);
  for (std::size_t n = 0; n < nodes; ++n) u[n] = {start[2 * n], start[2 * n + 1]};
  const reference::NodeGrid g{grid_.nx,        grid_.ny,           grid_.first_line,
                              grid_.line_step, grid_.first_sample, grid_.sample_step};
  const auto want = reference::regularised_step(as_reference(mean_), as_reference(difference_), g, u, model);
  const std::vector<float> got = queue_.read(out), likeness = queue_.read(correlation);
  double largest = 0;
  for (std::size_t n = 0; n < nodes; ++n) {
    EXPECT_NEAR(got[2 * n] - start[2 * n], want.correction[n][0], 1e-3) << n;
    EXPECT_NEAR(got[2 * n + 1] - start[2 * n + 1], want.correction[n][1], 1e-4) << n;
    EXPECT_NEAR(likeness[n], want.correlation[n], 1e-4) << n;
    largest = std::max(largest, std::abs(want.correction[n][1]));
  }
  EXPECT_GE(largest, 0.02);  // the comparison saw true corrections
}

TEST_F(RefinementTest, ACorrectionIsAsLongAsIsAllowedAtMost) {
  constexpr float kLateral = 0.02f, kAxial = 0.005f;
  Refinement refinement(queue_, kRefinementSolve, grid_, kLine, kSample);
  const auto nodes = static_cast<std::size_t>(grid_.nodes());
  Array<float> out = queue_.array<float>(2 * nodes), correlation = queue_.array<float>(nodes);
  refinement.measure(images(), true, correlation);
  const std::vector<float> start = field();
  refinement.step(queue_.array(start), out, kLateral, kAxial, kLast);
  const std::vector<float> got = queue_.read(out);
  int cut[2] = {};
  for (std::size_t n = 0; n < got.size(); ++n) {
    const float limit = n % 2 ? kAxial : kLateral, moved = std::abs(got[n] - start[n]);
    EXPECT_LE(moved, 1.001f * limit) << n;
    cut[n % 2] += moved >= 0.999f * limit;
  }
  EXPECT_GE(cut[0], 5);
  EXPECT_GE(cut[1], 5);
}

// A node whose own pixels are silent takes no correlation from its neighbours.
TEST_F(RefinementTest, ANodeThatHearsNothingItselfSaysNothing) {
  const int node = grid_.nx * (grid_.ny / 2) + grid_.nx / 2;
  const int line = grid_.first_line + grid_.nx / 2 * grid_.line_step;
  const int sample = grid_.first_sample + grid_.ny / 2 * grid_.sample_step;
  for (int l = line - grid_.line_step; l <= line + grid_.line_step; ++l)
    for (int k = sample - grid_.sample_step; k <= sample + grid_.sample_step; ++k) {
      const auto at = static_cast<std::size_t>(k + 211 * l);
      mean_.samples[at] = difference_.samples[at] = 0;
    }
  Refinement refinement(queue_, kRefinementSolve, grid_, kLine, kSample);
  Array<float> correlation = queue_.array<float>(static_cast<std::size_t>(grid_.nodes()));
  refinement.measure(
      {queue_.array(padded(mean_, pad_)), queue_.array(padded(difference_, pad_)), pad_.layout, 211, 23},
      false, correlation);
  const std::vector<float> likeness = queue_.read(correlation);
  EXPECT_EQ(likeness[static_cast<std::size_t>(node)], -2);
  EXPECT_EQ(std::count(likeness.begin(), likeness.end(), -2.0f), 1);
}

// Uniform strain costs nothing at the edges: only the difference moves the field, and here there is none.
TEST_F(RefinementTest, UniformStrainStaysAsItIs) {
  Refinement refinement(queue_, kRefinementSolve, grid_, kLine, kSample);
  Array<float> still = queue_.array<float>(pad_.total);
  queue_.fill_zero(still);
  const auto nodes = static_cast<std::size_t>(grid_.nodes());
  std::vector<float> start;
  for (std::size_t n = 0; n < nodes; ++n) {
    start.push_back(0.02f * static_cast<float>(n % grid_.nx) + 0.01f * static_cast<float>(n / grid_.nx));
    start.push_back(1 - 0.6f * static_cast<float>(n / grid_.nx));
  }
  Array<float> out = queue_.array<float>(2 * nodes), correlation = queue_.array<float>(nodes);
  refinement.measure({mean_device_, still, pad_.layout, 211, 23}, false, correlation);
  refinement.step(queue_.array(start), out, 1, 1, kLast);
  const std::vector<float> got = queue_.read(out);
  for (std::size_t n = 0; n < got.size(); ++n) EXPECT_NEAR(got[n], start[n], 1e-5) << n;
}

TEST_F(RefinementTest, SilentFramesKeepTheField) {
  Refinement refinement(queue_, kRefinementSolve, grid_, kLine, kSample);
  Array<float> silent = queue_.array<float>(pad_.total);
  queue_.fill_zero(silent);
  const auto nodes = static_cast<std::size_t>(grid_.nodes());
  const Array<float> start = queue_.array(std::vector<float>(2 * nodes, 0.25f));
  Array<float> out = queue_.array<float>(2 * nodes), correlation = queue_.array<float>(nodes);
  refinement.measure({silent, silent, pad_.layout, 211, 23}, true, correlation);
  refinement.step(start, out, 1, 1, kLast);
  for (const float u : queue_.read(out)) EXPECT_EQ(u, 0.25f);
  for (const float c : queue_.read(correlation)) EXPECT_EQ(c, -2);
}

}  // namespace
}  // namespace teletact::service
