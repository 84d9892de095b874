// Windows of tissue with one inclusion as displacement, strain and force for the modulus methods: from the
// simulated patient (another, finer discretisation) with noise of the size that tracking has, or from the
// strip itself (the inverse crime, for the test that provokes it).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <random>
#include <vector>

#include "client/patient/patient.h"
#include "service/imaging/modulus/judge.h"
#include "service/imaging/modulus/modulus.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service {

struct PhantomOptions {
  double x_m = 0.150, y_m = 0.014, diameter_m = 0.011, contrast = 3;  // of the inclusion; tissue coordinates
  double noise_m = 0.4e-6;                                            // of the axial displacement
  double push_m = 0.4e-3;
  unsigned seed = 1;
  double window_m = 0.120;  // left border of the probe, tissue coordinates
  double depth_m = 0.040;   // of the tissue
};

class Phantom {
 public:
  static constexpr double kWidthM = 0.060, kBackgroundPa = 10e3;

  explicit Phantom(PhantomOptions o) : options(o), queue_(imaging_device()->queue()) {
    client::Tissue t;
    t.depth_m = o.depth_m;
    t.inclusions = {{o.x_m, o.y_m, o.diameter_m, o.contrast}};
    const client::ProbeState& probe = pressed(t, o.window_m, o.push_m);
    force = {probe.force_n, probe.contact_area_m2};
    tissue = {t.width_m, t.depth_m, options.window_m, t.poisson_ratio};
    for (std::size_t n = 0; n < grid.size(); ++n) {
      const auto u = probe.field->at(options.window_m + x(n), y(n));
      axial.push_back(u.y), lateral.push_back(u.x);
    }
    add_noise();
  }

  // The displacement and force of the service's own strip with the true modulus and this tissue's nu and
  // plane.
  void take_from_strip() {
    StripModel model(tissue, kWidthM);
    const TissueGrid& g = model.grid();
    std::vector<double> modulus;
    for (std::size_t j = 0; j + 1 < g.ny(); ++j)
      for (std::size_t i = 0; i + 1 < g.nx(); ++i) {
        const double x_m = options.window_m + 0.5 * (g.x_m[i] + g.x_m[i + 1]) - options.x_m,
                     y_m = 0.5 * (g.y_m[j] + g.y_m[j + 1]) - options.y_m;
        modulus.push_back(kBackgroundPa *
                          (2 * std::hypot(x_m, y_m) < options.diameter_m ? options.contrast : 1));
      }
    const StripResponse response = model.solve(modulus);
    const WindowNodes nodes(model);
    std::vector<double> u[2];
    for (std::size_t n = 0; n < nodes.size(); ++n)
      for (std::size_t c = 0; c < 2; ++c)
        u[c].push_back(
            options.push_m *
            response.displacement[2 * g.node(model.first_column() + n % nodes.nx, n / nodes.nx) + c]);
    const Field x = nodes.on_image(u[0], grid), y = nodes.on_image(u[1], grid);
    lateral.assign(x.begin(), x.end()), axial.assign(y.begin(), y.end());
    force = {response.force_n_per_m * options.push_m * 0.010, kWidthM * 0.010};
    add_noise();
  }

  double x(std::size_t n) const { return grid.origin_x_m + static_cast<double>(n % grid.nx) * grid.dx_m; }
  double y(std::size_t n) const { return grid.origin_y_m + static_cast<double>(n / grid.nx) * grid.dy_m; }
  double truth(std::size_t n) const {
    return radii(n) < 1 ? options.contrast * kBackgroundPa : kBackgroundPa;
  }
  double radii(std::size_t n) const {
    return 2 * std::hypot(options.window_m + x(n) - options.x_m, y(n) - options.y_m) / options.diameter_m;
  }

  // Axial and lateral displacement -> what the methods get, strain by the product's own kernel.
  ModulusInput input() {
    std::vector<float> field;
    for (std::size_t n = 0; n < grid.size(); ++n)
      field.insert(field.end(), {static_cast<float>(lateral[n]), static_cast<float>(axial[n])});
    trusted.resize(grid.size(), 1);
    displacement_.grid.nx = static_cast<int>(grid.nx), displacement_.grid.ny = static_cast<int>(grid.ny);
    displacement_.field_m = queue_.array(field);
    displacement_.trusted = queue_.array(trusted);
    displacement_.correlation = queue_.array(std::vector<float>(grid.size(), 1));
    claim_noise(std::max(options.noise_m, 0.3e-6));
    measured_.grid = grid;
    download(queue_, displacement_, measured_);
    download(queue_, StrainEstimator(queue_, {}).estimate(displacement_, grid), measured_);
    return {measured_, kWidthM, tissue, force, known};
  }

  ModulusEstimate estimate(ModulusKind kind) {
    const auto strips = std::make_shared<StripCache>();
    const auto method = kind == ModulusKind::kReferenceStress ? make_reference_stress(queue_, {}, strips)
                        : kind == ModulusKind::kDirect        ? make_direct(queue_, {}, strips)
                                                              : make_iterative(queue_, strips);
    const ModulusInput in = input();
    ModulusEstimate out = method->estimate(in);
    judge(in, *strips, out);
    return out;
  }

  PhantomOptions options;
  ImageGrid grid{127, 98, 0.35e-3, 0.2e-3, 0.47e-3, 0.404e-3};
  std::vector<double> axial, lateral;
  std::vector<std::uint8_t> trusted;
  TissueExtent tissue;
  std::optional<ProbeForce> force;
  KnownModulus known;

 private:
  // The standard deviation and, about, the structure of add_noise(), as tracking states them: a mean over
  // 3 x 3 nodes.
  void claim_noise(double axial_m) {
    constexpr double kInformation = 1;
    const double size_m[] = {10 * axial_m, axial_m};
    auto noise = std::make_shared<NoiseStructure>();
    std::vector<float> std_m, information(2 * grid.size(), static_cast<float>(kInformation));
    for (std::size_t n = 0; n < grid.size(); ++n)
      for (const double s : size_m) std_m.push_back(static_cast<float>(s));
    for (std::size_t c = 0; c < 2; ++c) {
      noise->response[c] = NoiseResponse(SmootherResponse{1, 1, 3, 1}, kInformation, 1, 1);
      const DeviationTable whole = noise->response[c].deviation();
      noise->unit_m[c] = size_m[c] / static_cast<double>(whole[kBelowMedian]);
    }
    displacement_.std_m = queue_.array(std_m);
    displacement_.information = queue_.array(information);
    displacement_.noise = noise;
  }

  // Factoring a patient takes a second: each is kept.
  static const client::ProbeState& pressed(const client::Tissue& t, double window_m, double push_m) {
    static std::map<std::array<double, 5>, client::Patient> patients;
    static std::map<std::array<double, 7>, client::ProbeState> kept;
    const client::Inclusion& i = t.inclusions.front();
    const std::array<double, 5> who{i.x_m, i.y_m, i.diameter_m, i.contrast, t.depth_m};
    const std::array<double, 7> key{i.x_m, i.y_m, i.diameter_m, i.contrast, t.depth_m, window_m, push_m};
    auto found = kept.find(key);
    if (found == kept.end()) {
      const client::Patient& patient = patients.try_emplace(who, t).first->second;
      found = kept.emplace(key, patient.press(window_m, push_m)).first;
    }
    return found->second;
  }

  // White noise on windows of about 1.6 x 1.2 mm, as tracking has it; laterally ten times as much.
  void add_noise() {
    std::mt19937 random(options.seed);
    std::normal_distribution<double> normal;
    for (auto* field : {&axial, &lateral}) {
      std::vector<double> white(grid.size());
      for (double& w : white) w = normal(random);
      const double size = (field == &axial ? 1 : 10) * options.noise_m;
      for (std::size_t n = 0; n < grid.size(); ++n) {
        double sum = 0, count = 0;
        for (std::ptrdiff_t b = -1; b <= 1; ++b)
          for (std::ptrdiff_t a = -1; a <= 1; ++a) {
            const auto i = static_cast<std::ptrdiff_t>(n % grid.nx) + a,
                       j = static_cast<std::ptrdiff_t>(n / grid.nx) + b;
            if (i < 0 || j < 0 || i >= std::ptrdiff_t(grid.nx) || j >= std::ptrdiff_t(grid.ny)) continue;
            sum += white[std::size_t(i) + grid.nx * std::size_t(j)], ++count;
          }
        (*field)[n] += size * sum / std::sqrt(count);
      }
    }
  }

  Queue queue_;
  DisplacementEstimate displacement_;
  Measured measured_;
};

// What an estimate tells other windows: that of the nearest node.
inline KnownModulus known_from(const Phantom& phantom, const ModulusEstimate& estimate) {
  const auto kept = std::make_shared<const ModulusEstimate>(estimate);
  const auto nearest = [grid = phantom.grid, window_m = phantom.options.window_m](const Field& field,
                                                                                  double x, double y) {
    const double i = std::round((x - window_m - grid.origin_x_m) / grid.dx_m),
                 j = std::round((y - grid.origin_y_m) / grid.dy_m);
    if (!(i >= 0 && j >= 0 && i < double(grid.nx) && j < double(grid.ny))) return std::nan("");
    return double(field[std::size_t(i) + grid.nx * std::size_t(j)]);
  };
  return {[=](double x, double y) { return nearest(kept->youngs_modulus, x, y); },
          [=](double x, double y) { return nearest(kept->log_deviation, x, y); }};
}

}  // namespace teletact::service
