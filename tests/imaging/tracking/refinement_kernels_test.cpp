// Kernels of refinement.cl and pulse.cl that the comparison of whole steps (refinement_test.cpp) does not see
// by themselves, against the reference on awkward sizes.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "service/imaging/tracking/node_gradients.h"
#include "service/imaging/tracking/sample_grid.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"
#include "tests/reference/regularised.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

Range over(std::size_t items) {
  return {{items, 1, 1}, {32, 1, 1}};
}

std::vector<float> random_values(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<float> values(count);
  for (float& v : values) v = normal(random);
  return values;
}

reference::RfImage as_reference(const RfFrame& f) {
  return {
      static_cast<int>(f.sample_count), static_cast<int>(f.line_count), {f.samples.begin(), f.samples.end()}};
}

struct Solved {
  PcgResult result;
  Eigen::VectorXd x;
};
Solved solve(const Device& device, const BlockStencil& s, const Eigen::VectorXd& b,
             const PcgOptions& options) {
  const Queue queue = device.queue();
  NodeGradients gradients(queue, static_cast<int>(s.nx), static_cast<int>(s.ny));
  auto r = queue.array(std::vector<float>(b.begin(), b.end())), x = queue.array<float>(s.unknowns());
  Solved out{gradients.solve(queue.array(s.as<float>()), r, x, options), {}};
  const std::vector<float> found = queue.read(x);
  out.x = Eigen::Map<const Eigen::VectorXf>(found.data(), Eigen::Index(found.size())).cast<double>();
  return out;
}

TEST(NodeGradients, SolveWhatTheDenseFactorDoes) {
  PcgOptions options{.relative_error = 0, .relative_residual = 1e-5, .max_iterations = 500, .look_every = 4};
  for (const auto& device : {test_device(), test_gpu()})
    for (const auto& [nx, ny] : {std::pair{2U, 2U}, {33U, 17U}, {7U, 40U}}) {
      const BlockStencil s = random_stencil(nx, ny, 10, 1);
      const Eigen::VectorXd b = random_vectors(s, 1, 2).col(0), x = s.dense().ldlt().solve(b);
      const Solved solved = solve(*device, s, b, options);
      EXPECT_EQ(solved.result.reason, StopReason::kConverged);
      EXPECT_LE((solved.x - x).norm(), 1e-3 * x.norm()) << nx << " x " << ny;
      EXPECT_LE((s.dense() * solved.x - b).norm(), 2e-5 * b.norm());
    }
}

TEST(NodeGradients, StopWhereTheyShouldAndSayWhy) {
  PcgOptions options{.relative_error = 0, .relative_residual = 1e-3, .max_iterations = 500, .look_every = 4};
  const BlockStencil s = random_stencil(21, 16, 10, 1);
  const Eigen::VectorXd b = random_vectors(s, 1, 2).col(0);
  const Solved rough = solve(*test_device(), s, b, options);
  options.look_every = 1;  // when it looks changes nothing
  const Solved often = solve(*test_device(), s, b, options);
  EXPECT_EQ(rough.result.iterations, often.result.iterations);
  EXPECT_EQ(rough.x, often.x);
  EXPECT_LE(rough.result.recursive_residual, 1e-3 * b.norm());
  options.max_iterations = rough.result.iterations - 1;
  const Solved early = solve(*test_device(), s, b, options);
  EXPECT_EQ(early.result.reason, StopReason::kIterationLimit);
  EXPECT_EQ(early.result.iterations, options.max_iterations);
  EXPECT_GT(early.result.recursive_residual, 1e-3 * b.norm());
  options.max_iterations = 500;
  EXPECT_EQ(solve(*test_device(), s, Eigen::VectorXd::Zero(b.size()), options).x.norm(), 0);
  BlockStencil negative = s;
  for (double& value : negative.blocks) value = -value;
  EXPECT_EQ(solve(*test_device(), negative, b, options).result.reason, StopReason::kIndefinite);
  Eigen::VectorXd broken = b;
  broken[5] = std::nan("");
  EXPECT_EQ(solve(*test_device(), s, broken, options).result.reason, StopReason::kNotFinite);
}

TEST(RefinementKernels, EdgeBiasIsPullOverInformation) {
  const Queue queue = imaging_device()->queue();
  const reference::NodeGrid g{7, 11};
  constexpr std::size_t kNodes = 77;
  std::vector<float> information = random_values(2 * kNodes, 3), pull = random_values(2 * kNodes, 4);
  for (float& h : information) h *= h;
  for (const int j : {0, 1})  // a corner that hears nothing
    for (const int i : {0, 1}) information[2 * g.at(i, j)] = information[2 * g.at(i, j) + 1] = 0;
  std::vector<reference::Pair> h(kNodes), force(kNodes);
  for (std::size_t n = 0; n < kNodes; ++n) {
    h[n] = {information[2 * n], information[2 * n + 1]};
    force[n] = {pull[2 * n], pull[2 * n + 1]};
  }
  const std::vector<reference::Pair> want = reference::edge_bias(g, h, force, 1);
  Array<float> bias = queue.array<float>(2 * kNodes);
  queue.kernel("refinement", "edge_bias", Precision::kFloat)(over(kNodes), queue.array(information),
                                                             queue.array(pull), bias, g.nx, g.ny);
  const std::vector<float> got = queue.read(bias);
  EXPECT_EQ(got[0], 0);
  for (std::size_t n = 0; n < kNodes; ++n)
    for (std::size_t c = 0; c < 2; ++c)
      EXPECT_NEAR(got[2 * n + c], want[n][c], 1e-5 * (1 + std::abs(want[n][c]))) << n;
}

// A mean of speckle and a difference of noise and of what stretching makes of it, 211 x 23 samples.
class PulseTest : public ::testing::Test {
 protected:
  static constexpr double kNoise = 0.05;  // of the speckle's RMS
  PulseTest() : queue_(imaging_device()->queue()) {
    SpeckleOptions options;
    options.samples = 211;
    options.lines = 23;
    const Speckle speckle(options);
    mean_ = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    double squares = 0;
    for (const float m : mean_.samples) squares += m * m / static_cast<double>(mean_.samples.size());
    variance_ = kNoise * kNoise * squares;
    pad_ = padding(mean_, 48, 10);
    grid_ = centred_grid(mean_, 2, 21);
  }
  // yy, xy: parts of the mean's derivatives in the difference.
  RfFrame difference(double yy, double xy) const {
    const auto image = as_reference(mean_);
    const std::vector<float> noise = random_values(mean_.samples.size(), 5);
    RfFrame d = mean_;
    for (int l = 0; l < 23; ++l)
      for (int k = 0; k < 211; ++k) {
        const auto at = [&](int n, int q) { return image.at(k + n, l + q); };
        const auto n = static_cast<std::size_t>(k) + 211 * static_cast<std::size_t>(l);
        const double bend = 1.5 * (at(1, 0) + at(-1, 0)) - 0.15 * (at(2, 0) + at(-2, 0)) +
                            (at(3, 0) + at(-3, 0)) / 90 - 49.0 / 18 * at(0, 0);
        const double shear = (at(1, 1) - at(-1, 1) - at(1, -1) + at(-1, -1)) / 4;
        d.samples[n] = static_cast<float>(yy * bend + xy * shear + std::sqrt(variance_) * noise[n]);
      }
    return d;
  }
  // noise and information after pulse_noise(), of `noise` and information 1 before.
  std::pair<std::vector<float>, std::vector<float>> run(const RfFrame& d, const std::vector<float>& noise) {
    const auto nodes = static_cast<std::size_t>(grid_.nodes());
    Array<float> pulses = queue_.array<float>(16 * nodes), left = queue_.array(noise),
                 information = queue_.array(std::vector<float>(2 * nodes, 1.0f));
    queue_.kernel("pulse", "pulse_sums", Precision::kFloat)(over(nodes), queue_.array(padded(mean_, pad_)),
                                                            queue_.array(padded(d, pad_)), left, pulses,
                                                            grid_, pad_.layout, 23);
    queue_.kernel("pulse", "pulse_noise", Precision::kFloat)(over(nodes), pulses, left, information, grid_.nx,
                                                             grid_.ny, 2);
    return {queue_.read(left), queue_.read(information)};
  }

  Queue queue_;
  RfFrame mean_;
  double variance_ = 0;  // of the noise
  Padding pad_;
  SampleGrid grid_;
};

TEST_F(PulseTest, PartLeftMatchesTheReference) {
  RfFrame d = difference(0.1, 0.2);
  d.samples[1500] = 900;
  std::vector<float> noise = random_values(static_cast<std::size_t>(grid_.nodes()), 6);
  for (float& n : noise) n = static_cast<float>(variance_) * (1 + n * n);
  noise[3] = 0;
  const auto [got, information] = run(d, noise);
  const reference::NodeGrid g{grid_.nx,        grid_.ny,           grid_.first_line,
                              grid_.line_step, grid_.first_sample, grid_.sample_step};
  for (int j = 0; j < g.ny; ++j)
    for (int i = 0; i < g.nx; ++i) {
      const std::size_t n = g.at(i, j);
      const double want = reference::unexplained_part(as_reference(mean_), as_reference(d), g, i, j,
                                                      {noise.begin(), noise.end()}, {});
      if (noise[n] == 0) {
        EXPECT_EQ(got[n], 0);  // a node that hears nothing stays silent
        continue;
      }
      EXPECT_NEAR(got[n] / noise[n], want, 1e-3) << n;
      EXPECT_NEAR(information[2 * n] * want, 1, 5e-3) << n;
      EXPECT_NEAR(information[2 * n + 1] * want, 1, 5e-3) << n;
    }
}

// However much stretching there is, the noise is what is left: of the pixels' mean squared difference that
// part which is noise, less the few freedoms of the fit.
TEST_F(PulseTest, StretchedPulseIsNoNoise) {
  for (const double part : {0.0, 0.05, 0.1}) {
    const RfFrame d = difference(part, 2 * part);
    double squares = 0;
    for (const float v : d.samples) squares += v * v / static_cast<double>(d.samples.size());
    const auto nodes = static_cast<std::size_t>(grid_.nodes());
    const std::vector<float> loud(nodes, static_cast<float>(1e6 * squares));  // all pixels weigh the same
    const std::vector<float> got = run(d, loud).first;
    double left = 0;
    for (const float n : got) left += n / (1e6 * squares) / static_cast<double>(nodes);
    EXPECT_NEAR(left * squares / variance_, 1, part > 0 ? 0.15 : 0.05) << part;
  }
}

}  // namespace
}  // namespace teletact::service
