// Kernels of refinement.cl and pulse.cl that the comparison of whole steps (refinement_test.cpp) does not see
// by themselves, against the reference on awkward sizes.
#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
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

// As an assembled step: a block of its own for each node, definite, and weights to the four beside it.
struct TestSystem {
  int nx, ny;
  std::vector<float> weights{0.7f, 1.3f, 2.1f, 0.4f};
  std::vector<float> diagonal{}, cross{};  // two a node
  Eigen::SparseMatrix<double> matrix{};
};
TestSystem random_system(int nx, int ny, float least = 0.05f, float sign = 1, float edges = 1) {
  TestSystem s{nx, ny};
  const auto nodes = static_cast<std::size_t>(nx * ny);
  std::vector<float> own = random_values(3 * nodes, 7);
  for (float& weight : s.weights) weight *= sign * edges;
  std::vector<Eigen::Triplet<double>> entries;
  for (int n = 0; n < nx * ny; ++n) {
    const float* const v = own.data() + 3 * n;
    const float cross = sign * v[0] * v[1];
    float diagonal[2] = {sign * (v[0] * v[0] + least), sign * (v[1] * v[1] + v[2] * v[2] + least)};
    for (const auto& [di, dj] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
      if (n % nx + di < 0 || n % nx + di >= nx || n / nx + dj < 0 || n / nx + dj >= ny) continue;
      for (int c = 0; c < 2; ++c) {
        const float weight = s.weights[static_cast<std::size_t>(c + (dj == 0 ? 0 : 2))];
        diagonal[c] += weight;
        entries.emplace_back(2 * n + c, 2 * (n + di + nx * dj) + c, -weight);
      }
    }
    for (int c = 0; c < 2; ++c) {
      s.diagonal.push_back(diagonal[c]), s.cross.push_back(cross);
      entries.emplace_back(2 * n + c, 2 * n + c, diagonal[c]);
      entries.emplace_back(2 * n + c, 2 * n + 1 - c, cross);
    }
  }
  s.matrix.resize(2 * nx * ny, 2 * nx * ny);
  s.matrix.setFromTriplets(entries.begin(), entries.end());
  return s;
}

struct Solved {
  PcgResult result;
  Eigen::VectorXd x;
  std::uint64_t launches = 0;
};
Solved solve(const Device& device, const TestSystem& s, const Eigen::VectorXd& b, const PcgOptions& options) {
  const Queue queue = device.queue();
  NodeGradients gradients(queue, s.nx, s.ny);
  const NodeLayout& layout = gradients.layout();
  const auto at = [&](int n) {
    return 2 * static_cast<std::size_t>(n % s.nx + layout.stride * (n / s.nx + 1));
  };
  const auto placed = [&](auto&& values) {
    std::vector<float> out(layout.size, 0.0f);
    for (int n = 0; n < s.nx * s.ny; ++n)
      for (int c = 0; c < 2; ++c)
        out[at(n) + static_cast<std::size_t>(c)] = static_cast<float>(values(2 * n + c));
    return queue.array(out);
  };
  const auto of = [](const std::vector<float>& v) {
    return [&v](int n) { return v[static_cast<std::size_t>(n)]; };
  };
  constexpr std::size_t kAt = 3;  // of the numbers that say how it ended
  Array<float> r = placed(b), x = queue.array(std::vector<float>(layout.size, 5.0f)),
               ends = queue.array<float>(kAt + NodeGradients::kEnd);
  const auto diagonal = placed(of(s.diagonal)), cross = placed(of(s.cross)), weights = queue.array(s.weights);
  gradients.solve({diagonal, cross, weights}, r, x, ends, kAt, options);
  r = placed(b);
  queue.take_work();
  gradients.solve({diagonal, cross, weights}, r, x, ends, kAt, options);  // whatever the last one left
  Solved out{NodeGradients::result(queue.read(ends).data() + kAt), Eigen::VectorXd(b.size()),
             queue.take_work().launches};
  const std::vector<float> found = queue.read(x);
  for (int n = 0; n < s.nx * s.ny; ++n)
    for (int c = 0; c < 2; ++c) out.x[2 * n + c] = found[at(n) + static_cast<std::size_t>(c)];
  return out;
}

TEST(NodeGradients, SolveWhatAFactorDoes) {
  PcgOptions options{.relative_error = 0, .relative_residual = 1e-5, .max_iterations = 500};
  for (const auto& device : {test_device(), test_gpu()})
    for (const auto& [nx, ny] : {std::pair{2, 2}, {1, 9}, {33, 17}, {7, 40}}) {
      const TestSystem s = random_system(nx, ny);
      const Eigen::VectorXd b = Eigen::VectorXd::Random(s.matrix.rows()),
                            x = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(s.matrix).solve(b);
      const Solved solved = solve(*device, s, b, options);
      EXPECT_EQ(solved.result.reason, StopReason::kConverged);
      EXPECT_LE((solved.x - x).norm(), 1e-3 * x.norm()) << nx << " x " << ny;
      EXPECT_LE((s.matrix * solved.x - b).norm(), 2e-5 * b.norm());
    }
}

TEST(NodeGradients, StopWhereTheyShouldAndSayWhy) {
  PcgOptions options{.relative_error = 0, .relative_residual = 1e-3, .max_iterations = 500};
  const TestSystem s = random_system(21, 16);
  Eigen::VectorXd b = Eigen::VectorXd::Random(s.matrix.rows());
  const Solved rough = solve(*test_device(), s, b, options);
  EXPECT_LE(rough.result.recursive_residual, 1e-3 * b.norm());
  options.max_iterations = rough.result.iterations - 1;
  const Solved early = solve(*test_device(), s, b, options);
  EXPECT_EQ(early.result.reason, StopReason::kIterationLimit);
  EXPECT_EQ(early.result.iterations, options.max_iterations);
  EXPECT_GT(early.result.recursive_residual, 1e-3 * b.norm());
  options.max_iterations = 500;
  EXPECT_EQ(solve(*test_device(), s, Eigen::VectorXd::Zero(b.size()), options).x.norm(), 0);
  EXPECT_EQ(solve(*test_device(), random_system(21, 16, 0.05f, -1), b, options).result.reason,
            StopReason::kIndefinite);
  b[5] = std::nan("");
  EXPECT_EQ(solve(*test_device(), s, b, options).result.reason, StopReason::kNotFinite);
}

// On a large grid the iterations come in several launches, each from where the last one ended.
TEST(NodeGradients, GoOnInAnotherLaunch) {
  PcgOptions options{.relative_error = 0, .relative_residual = 1e-5, .max_iterations = 500};
  const TestSystem s = random_system(47, 400, 1e-4f, 1, 100);
  const Eigen::VectorXd b = Eigen::VectorXd::Random(s.matrix.rows());
  const Solved once = solve(*test_device(), s, b, options), often = solve(*test_gpu(), s, b, options);
  EXPECT_LT(once.launches, often.launches);
  ASSERT_GT(often.launches, 1u);
  EXPECT_GT(often.result.iterations, options.max_iterations / (often.launches - 1)) << "of one launch";
  EXPECT_EQ(often.result.reason, StopReason::kConverged);
  EXPECT_LE((often.x - once.x).norm(), 1e-4 * once.x.norm());
  constexpr double kOfRounding = 5;
  EXPECT_NEAR(double(often.result.iterations), double(once.result.iterations), kOfRounding);
}

// Weights from medians by counting, against the same by sorting, in double.
TEST(RefinementKernels, EdgesAreWeighedByMedians) {
  struct {
    float dx, dy, line, sample, least, change, shortest, longest[2];
  } const s{0.47e-3f, 0.4e-3f, 0.235e-3f, 19.25e-6f, 1e-4f, 1e-4f, 0.25e-3f, {1.5e-3f, 1.0e-3f}};
  for (const auto& device : {test_device(), test_gpu()})
    for (const std::size_t nodes : {1U, 2U, 4099U})
      for (const bool heard : {true, false}) {
        const Queue queue = device->queue();
        const std::size_t width = std::clamp<std::size_t>(device->info().width<float>(), 2, 16),
                          group = device->info().gpu ? 512 : 1;
        const auto whole = [&](std::vector<float> values) {
          values.resize((values.size() + width - 1) / width * width, 0.0f);
          return queue.array(values);
        };
        std::vector<float> information = random_values(2 * nodes, 8), strain = random_values(nodes, 9);
        for (float& h : information) h = heard && h > -0.5f ? 1e5f * std::abs(h) : 0;
        for (float& e : strain) e = 0.3f * std::abs(e);
        const Array<float> h = whole(information), e = whole(strain);
        Array<float> model = queue.array(std::vector<float>(12, -1.0f));
        queue.kernel("smoothing", "weigh_edges", Precision::kFloat,
                     {{"GROUP", std::to_string(group)}, {"WIDTH", std::to_string(width)}})(
            {{group}, {group}}, h, e, model, s, static_cast<int>(nodes), static_cast<int>(h.size() / width),
            static_cast<int>(e.size() / width));
        const std::vector<float> got = queue.read(model);
        std::sort(strain.begin(), strain.end());
        const double change = s.change * std::max<double>(s.least, strain[nodes / 2] * s.sample / s.dy);
        for (std::size_t c = 0; c < 2; ++c) {
          std::vector<float> held;
          for (std::size_t n = c; n < information.size(); n += 2)
            if (information[n] > 0) held.push_back(information[n]);
          std::sort(held.begin(), held.end());
          const float median = held.empty() ? 0 : held[held.size() / 2];
          EXPECT_EQ(got[8 + c], median) << nodes;
          const double known = std::max<double>(median, 1e-12), pitch = c == 0 ? s.line : s.sample,
                       length = std::clamp<double>(std::sqrt(s.dx * s.dy / known) * pitch / change,
                                                   s.shortest, s.longest[c]);
          EXPECT_NEAR(got[10 + c] / length, 1, 1e-6) << nodes;
          EXPECT_NEAR(got[c] / (known * length * length / (s.dx * s.dx)), 1, 1e-6) << nodes;
          EXPECT_NEAR(got[2 + c] / (known * length * length / (s.dy * s.dy)), 1, 1e-6) << nodes;
          EXPECT_EQ(got[4 + c], -1) << "noise's";
        }
      }
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
