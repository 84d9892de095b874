// Tissue drawn from the prior that the iterative modulus states: what it states of its error holds (T3.5).
// The suite `posterior` tells it over many more.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>

#include "bench/phantoms/drawn_window.h"
#include "service/imaging/modulus/judge.h"

namespace teletact::bench {
namespace {

TEST(DrawnWindow, TheModulusIsOffByWhatItStates) {
  const auto device = service::Device::open();
  const service::Queue queue = device->queue();
  const auto strips = std::make_shared<service::StripCache>();
  const auto method = service::make_iterative(queue, strips);
  for (const double strain : {0.01, 0.03}) {
    double squares = 0, count = 0, beyond = 0;
    for (const std::uint64_t seed : {1, 2, 3}) {
      const DrawnWindow window({.strain = strain}, seed, queue);
      const service::ModulusInput in = window.input();
      service::ModulusEstimate e = method->estimate(in);
      service::judge(in, *strips, e);
      EXPECT_GT(e.correlation_m, 0.3e-3);
      EXPECT_LT(e.correlation_m, 20e-3);
      for (std::size_t n = 0; n < window.grid().size(); ++n) {
        if (!std::isfinite(e.youngs_modulus[n])) continue;
        const double z = (std::log(e.youngs_modulus[n]) - window.log_modulus(n)) / e.log_deviation[n];
        squares += z * z, beyond += std::abs(z) > 1.96, ++count;
      }
    }
    std::printf("%g %%: standardised errors %.2f, %.3f beyond 1.96\n", 100 * strain,
                std::sqrt(squares / count), beyond / count);
    EXPECT_GE(std::sqrt(squares / count), 0.75);
    EXPECT_LE(std::sqrt(squares / count), 1.25);
    EXPECT_LE(beyond / count, 0.08);
  }
}

}  // namespace
}  // namespace teletact::bench
