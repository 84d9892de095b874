// Windows that tell each other what lies beside them (T3.1): the errors of one must not grow in the others.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/strip_model.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr double kWidthM = 0.240, kDepthM = 0.040, kWindowM = 0.060, kPushM = 0.4e-3;
const ImageGrid kImage{122, 80, 0.25e-3, 0.2e-3, 0.49e-3, 0.49e-3};

// Strain and force of the true tissue under the probe at x, on a device.
class Pressed {
 public:
  Pressed(const TrueModulus& truth, double x_m) : tissue_{kWidthM, kDepthM, x_m, 0.49} {
    StripModel model(tissue_, kWindowM);
    const TissueGrid& g = model.grid();
    std::vector<double> modulus;
    for (std::size_t j = 0; j + 1 < g.ny(); ++j)
      for (std::size_t i = 0; i + 1 < g.nx(); ++i)
        modulus.push_back(truth(x_m + 0.5 * (g.x_m[i] + g.x_m[i + 1]), 0.5 * (g.y_m[j] + g.y_m[j + 1])));
    StripResponse response = model.solve(modulus);
    force_ = {response.force_n_per_m * kPushM * 0.010, kWindowM * 0.010};
    for (std::size_t n = 0; n < modulus.size(); ++n) response.stress[n] *= kPushM / modulus[n];
    measured_.grid = kImage;
    measured_.axial_strain = model.on_image(response.stress, kImage);
    measured_.strain_valid.assign(kImage.size(), 1);
  }
  WindowEstimate estimate(ModulusMethod& method, const KnownModulus& known) const {
    WindowEstimate w{tissue_.window_x_m, kWindowM, kImage, {}, {}};
    w.youngs_modulus_pa = method.estimate({measured_, kWindowM, tissue_, force_, known}).youngs_modulus;
    for (const float e : w.youngs_modulus_pa) w.valid.push_back(std::isfinite(e) ? 1 : 0);
    return w;
  }

 private:
  TissueExtent tissue_;
  ProbeForce force_;
  Measured measured_;
};

// Mean |log(E / truth)| of the measured cells in the upper 25 mm, further than 2 mm from an inclusion's rim.
double error(const StitchedMap& map, const TrueModulus& truth) {
  double sum = 0, count = 0;
  const std::vector<CellState> states = map.states();
  const std::vector<float> moduli_pa = map.youngs_modulus_pa();
  for (std::size_t n = 0; n < states.size(); ++n) {
    const double x = (static_cast<double>(n % map.nx()) + 0.5) * map.cell_x_m();
    const double y = (static_cast<double>(n / map.nx()) + 0.5) * map.cell_y_m();
    const bool rim = truth(x - 2e-3, y) != truth(x + 2e-3, y) || truth(x, y - 2e-3) != truth(x, y + 2e-3);
    if (y > 0.025 || rim || states[n] != CellState::kMeasured) continue;
    sum += std::abs(std::log(static_cast<double>(moduli_pa[n]) / truth(x, y)));
    ++count;
  }
  return sum / count;
}

TEST(KnownModulus, ErrorsOfOneWindowDoNotGrowInTheOthers) {
  const Queue queue = Device::open()->queue();
  const auto method = make_reference_stress(queue, {});
  const TrueModulus left = inclusion(10e3, 6, 0.062, 0.013, 0.006),
                    right = inclusion(1, 5, 0.186, 0.011, 0.005);
  const TrueModulus truth = [&](double x, double y) { return left(x, y) * right(x, y); };
  std::vector<Pressed> windows;
  for (int k = 0; k < 4; ++k) windows.emplace_back(truth, kWindowM * k);
  auto alone = std::make_shared<StitchedMap>(tissue(kWidthM, kDepthM));
  for (const Pressed& w : windows) alone->paste(w.estimate(*method, {}));
  const double unaware = error(*alone, truth);
  auto map = std::make_shared<StitchedMap>(tissue(kWidthM, kDepthM));
  std::printf("mean |log E error|: alone %.3f, passes", unaware);
  double last = 1.15 * unaware;
  for (int pass = 0; pass < 4; ++pass) {
    for (std::size_t k = 0; k < windows.size(); ++k) {
      const Pressed& w = windows[pass % 2 ? windows.size() - 1 - k : k];
      map->paste(w.estimate(*method, known_modulus(map)));
    }
    const double aware = error(*map, truth);
    std::printf(" %.3f", aware);
    // The first window knows nothing and the second what the first made of it.
    EXPECT_LE(aware, (pass == 0 ? 1.15 : 0.9) * unaware) << pass;
    EXPECT_LE(aware, 1.02 * last) << pass;
    last = aware;
  }
  std::printf("\n");
}

TEST(KnownModulus, IsTheMapsCellAndNothingOutsideIt) {
  auto map = std::make_shared<StitchedMap>(tissue(0.120, 0.040));
  map->paste(window_of([](double x, double y) { return 1e4 * (1 + x) * (1 + y); }, 0.030, 0.060, 0.040));
  const KnownModulus known = known_modulus(map);
  EXPECT_NEAR(known(0.0512, 0.0203), 1e4 * 1.0512 * 1.0203, 20);
  EXPECT_NEAR(known(0.0302, 0.0203), 1e4 * 1.0302 * 1.0203, 20);
  for (const auto& [x, y] :
       {std::pair{0.029, 0.02}, {0.0905, 0.02}, {-0.001, 0.02}, {0.121, 0.02}, {0.05, -1e-6}, {0.05, 0.0401}})
    EXPECT_TRUE(std::isnan(known(x, y))) << x << " " << y;
  EXPECT_FALSE(known_modulus(nullptr));
}

}  // namespace
}  // namespace teletact::service
