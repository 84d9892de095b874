// The kernels between and after the searches (medians, smoothing, peaks, resampling, report, reference
// stress) against plain loops, on random fields with holes and awkward sizes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "service/imaging/tracking/sample_grid.h"
#include "tests/imaging/imaging_device.h"
#include "tests/reference/filters.h"

namespace teletact::service {
namespace {

Range over(std::size_t items) {
  Range range;
  range.global[0] = items;
  range.local[0] = 32;
  return range;
}

struct Fields {
  Fields(int columns, int rows, unsigned seed) : nx(columns), ny(rows), random(seed) {
    for (int n = 0; n < nx * ny; ++n) {
      prediction.push_back(0.1f * static_cast<float>(n % nx));
      prediction.push_back(-2.0f * static_cast<float>(n / nx));
    }
    std::normal_distribution<float> normal;
    std::uniform_real_distribution<float> uniform(0, 1);
    for (std::size_t n = 0; n < prediction.size(); ++n)
      field.push_back(prediction[n] + 0.3f * normal(random) + (uniform(random) < 0.1f ? 5.5f : 0.0f));
    for (int n = 0; n < nx * ny; ++n) correlation.push_back(uniform(random));
  }
  reference::VectorField as_reference(const std::vector<float>& interleaved) const {
    reference::VectorField out{nx, ny, {}, {}};
    for (std::size_t n = 0; n < interleaved.size(); n += 2) {
      out.lateral.push_back(interleaved[n]);
      out.axial.push_back(interleaved[n + 1]);
    }
    return out;
  }
  int nx, ny;
  std::mt19937 random;
  std::vector<float> prediction, field, correlation;
};

void expect_equal(const std::vector<float>& got, const reference::VectorField& want) {
  ASSERT_EQ(got.size(), 2 * want.axial.size());
  for (std::size_t n = 0; n < want.axial.size(); ++n) {
    EXPECT_NEAR(got[2 * n], want.lateral[n], 1e-5) << n;
    EXPECT_NEAR(got[2 * n + 1], want.axial[n], 1e-5) << n;
  }
}

class FilterKernels : public ::testing::TestWithParam<std::pair<int, int>> {
 protected:
  FilterKernels() : queue(imaging_device()->queue()), f(GetParam().first, GetParam().second, 3) {}
  Kernel kernel(const char* name) { return queue.kernel("displacement", name, Precision::kFloat); }
  std::size_t nodes() const { return f.correlation.size(); }
  Queue queue;
  Fields f;
};

TEST_P(FilterKernels, MedianFilterMatchesReference) {
  const std::vector<double> correlation(f.correlation.begin(), f.correlation.end());
  for (const int radius : {1, 2})
    for (const float threshold : {0.0f, 0.5f, 0.9f}) {
      const Array<float> out = queue.array<float>(f.field.size()), deviation = queue.array<float>(nodes());
      kernel("median_filter")(over(nodes()), queue.array(f.field), queue.array(f.prediction),
                              queue.array(f.correlation), out, deviation, f.nx, f.ny, radius, threshold, 0.5f,
                              1.0f);
      const auto want = reference::median_filter(f.as_reference(f.field), f.as_reference(f.prediction),
                                                 correlation, radius, threshold, 0.5, 1.0);
      expect_equal(queue.read(out), want.field);
      const std::vector<float> off = queue.read(deviation);
      for (std::size_t n = 0; n < off.size(); ++n) {
        const bool none = std::isinf(want.deviation[n]);
        EXPECT_EQ(none, std::isinf(off[n])) << n;
        EXPECT_NEAR(none ? 0 : off[n], none ? 0 : want.deviation[n], 1e-5) << n;
      }
    }
}

TEST_P(FilterKernels, SmoothingMatchesReference) {
  const Array<float> out = queue.array<float>(f.field.size());
  kernel("smooth")(over(nodes()), queue.array(f.field), out, f.nx, f.ny);
  expect_equal(queue.read(out), reference::smooth(f.as_reference(f.field)));
}

TEST_P(FilterKernels, ResamplingMatchesReference) {
  // Onto a finer grid that reaches beyond the first one on every side.
  const int nx = 2 * f.nx + 5, ny = 3 * f.ny + 7;
  const Array<float> out = queue.array<float>(static_cast<std::size_t>(2 * nx * ny));
  kernel("resample")(over(static_cast<std::size_t>(nx * ny)), queue.array(f.field), out,
                     SampleGrid{f.nx, f.ny, 7, 4, 40, 25}, SampleGrid{nx, ny, 3, 2, 11, 9});
  const auto from = f.as_reference(f.field);
  reference::VectorField want{nx, ny, {}, {}};
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      const double column = (3 + 2 * i - 7) / 4.0, row = (11 + 9 * j - 40) / 25.0;
      want.lateral.push_back(reference::bilinear(from.lateral, f.nx, f.ny, column, row));
      want.axial.push_back(reference::bilinear(from.axial, f.nx, f.ny, column, row));
    }
  expect_equal(queue.read(out), want);
}

TEST_P(FilterKernels, ReportScalesAndJudges) {
  std::vector<float> deviation(nodes());
  for (float& d : deviation) d = std::uniform_real_distribution<float>(0, 2)(f.random);
  deviation.back() = INFINITY;
  f.correlation.front() = std::nanf("");
  // Nodes on every second line and fifth sample of a frame that ends with them; one line is silent at its end
  // after the motion, one at its beginning before.
  const SampleGrid g{f.nx, f.ny, 0, 2, 0, 5};
  const int lines = 2 * f.nx - 1, samples = 5 * f.ny - 4;
  std::vector<EchoSpan> spans(static_cast<std::size_t>(lines), {0, samples});
  spans[spans.size() / 2].end = samples / 2;
  std::vector<EchoSpan> before(spans.size(), {0, samples});
  before.back().first = samples / 3;
  const Array<float> out = queue.array<float>(f.field.size());
  const Array<std::uint8_t> trusted = queue.array<std::uint8_t>(nodes());
  kernel("report")(over(nodes()), queue.array(f.field), queue.array(f.correlation), queue.array(deviation),
                   queue.array(before), queue.array(spans), out, trusted, g, lines, 0.2f, 0.02f, 0.6f, 1.0f);
  const std::vector<float> metres = queue.read(out);
  const std::vector<std::uint8_t> flags = queue.read(trusted);
  for (std::size_t n = 0; n < nodes(); ++n) {
    EXPECT_NEAR(metres[2 * n], 0.2 * f.field[2 * n], 1e-5) << n;
    EXPECT_NEAR(metres[2 * n + 1], 0.02 * f.field[2 * n + 1], 1e-5) << n;
    const int i = static_cast<int>(n) % f.nx, j = static_cast<int>(n) / f.nx;
    const float line = static_cast<float>(2 * i) + f.field[2 * n],
                sample = static_cast<float>(5 * j) + f.field[2 * n + 1];
    const auto own = std::clamp(std::lround(line), 0L, static_cast<long>(lines - 1));
    const bool inside = 5 * j >= before[static_cast<std::size_t>(2 * i)].first && line >= -0.5f &&
                        line < static_cast<float>(lines) - 0.5f && sample >= 0 &&
                        sample < static_cast<float>(spans[static_cast<std::size_t>(own)].end);
    EXPECT_EQ(flags[n] != 0, f.correlation[n] >= 0.6f && deviation[n] <= 1.0f && inside) << n;
  }
}

TEST_P(FilterKernels, PeakIsTheVertexOfTheParabolas) {
  const int lateral_count = 5, first_lag = -4, first_lateral = -2;
  std::vector<float> volume(nodes() * 8 * lateral_count);
  for (float& v : volume) v = std::uniform_real_distribution<float>(-1, 1)(f.random);
  const Array<float> out = queue.array<float>(f.field.size()), peak = queue.array<float>(nodes());
  const SampleGrid g{f.nx, f.ny, 1,
                     2,    3,    5};  // of which the last column hears nothing from its second row on
  std::vector<EchoSpan> spans(static_cast<std::size_t>(2 * f.nx), {0, 5 * f.ny});
  spans[static_cast<std::size_t>(2 * f.nx - 1)] = {0, 8};
  queue.kernel("search", "ncc_peak", Precision::kFloat)(over(nodes()), queue.array(volume),
                                                        queue.array(spans), queue.array(f.field), out, peak,
                                                        g, first_lag, first_lateral, lateral_count);
  const std::vector<float> moved = queue.read(out), largest = queue.read(peak);
  const auto vertex = [](double a, double b, double c) {
    return std::clamp((a - c) / (2 * (a - 2 * b + c)), -0.5, 0.5);
  };
  for (std::size_t n = 0; n < nodes(); ++n) {
    const float* const v = volume.data() + n * 8 * lateral_count;
    const auto best = std::max_element(v, v + 8 * lateral_count) - v;
    const auto lag = best % 8, m = best / 8;
    double axial = static_cast<double>(first_lag + lag), lateral = static_cast<double>(first_lateral + m);
    if (lag > 0 && lag < 7) axial += vertex(v[best - 1], v[best], v[best + 1]);
    if (m > 0 && m + 1 < lateral_count) lateral += vertex(v[best - 8], v[best], v[best + 8]);
    const bool silent = static_cast<int>(n) % f.nx == f.nx - 1 && static_cast<int>(n) >= f.nx;
    EXPECT_EQ(largest[n], silent ? 0 : v[best]) << n;
    EXPECT_NEAR(moved[2 * n] - f.field[2 * n], lateral, 2e-5) << n;
    EXPECT_NEAR(moved[2 * n + 1] - f.field[2 * n + 1], axial, 2e-5) << n;
  }
}

// Strain, stress and trust with all that may be said and all that may not.
TEST_P(FilterKernels, ReferenceStressAndItsMedianMatchReference) {
  const float amplitude = -0.7e-6f, scale = 1.3e4f, min_strain = 2e-4f, range = 20;
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<float> strains, stress;
  std::vector<double> axial, stress_double;
  std::vector<std::uint8_t> trusted;
  for (std::size_t n = 0; n < nodes(); ++n) {
    const float strain =
        0.01f * std::pow(1e-3f, uniform(f.random)) * (uniform(f.random) < 0.1f ? 1.0f : -1.0f);
    strains.push_back(strain);
    stress.push_back(uniform(f.random) < 0.1f ? std::nanf("") : 1e4f * uniform(f.random));
    trusted.push_back(uniform(f.random) < 0.8f);
    axial.push_back(strain);
    stress_double.push_back(stress.back());
  }
  const Array<float> raw = queue.array<float>(nodes()), out = queue.array<float>(nodes());
  const auto modulus = [&](const char* name) { return queue.kernel("modulus", name, Precision::kFloat); };
  modulus("reference_stress")(over(nodes()), queue.array(strains), queue.array(trusted), queue.array(stress),
                              raw, f.nx, f.ny, amplitude, scale, min_strain, range, 1);
  const auto want = reference::reference_stress(f.nx, axial, trusted, stress_double, amplitude, scale,
                                                {min_strain, range, 1});
  const auto same = [](const std::vector<float>& got, const std::vector<double>& expected) {
    for (std::size_t n = 0; n < got.size(); ++n) {
      ASSERT_EQ(std::isnan(got[n]), std::isnan(expected[n])) << n;
      if (std::isnan(got[n])) continue;
      EXPECT_NEAR(got[n], expected[n], 1e-5 * expected[n]) << n;
    }
  };
  same(queue.read(raw), want);
  for (const int radius : {1, 2}) {
    modulus("modulus_median")(over(nodes()), raw, out, f.nx, f.ny, radius);
    same(queue.read(out), reference::modulus_median(f.nx, f.ny, want, radius));
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, FilterKernels,
                         ::testing::Values(std::pair{1, 1}, std::pair{1, 7}, std::pair{9, 1}, std::pair{2, 3},
                                           std::pair{23, 17}),
                         [](const auto& info) {
                           return std::to_string(info.param.first) + "x" + std::to_string(info.param.second);
                         });

}  // namespace
}  // namespace teletact::service
