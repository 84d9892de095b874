// Reference stress (T3.1): E_(n+1) = (P / P[E_n]) E_n eps[E_n] / eps_yy, from homogeneous tissue on.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/seed.h"
#include "service/imaging/tracking/median.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {
namespace {

constexpr double kRange = 20;           // of E over its median, either way
constexpr double kUnsaidDepthM = 1e-3;  // depth in which nothing is said: strain kernels are cut there
constexpr int kMedianRadius = 2;        // nodes

class ReferenceStress : public ModulusMethod {
 public:
  ReferenceStress(Queue queue, ReferenceStressOptions options, std::shared_ptr<StripCache> strips)
      : queue_(std::move(queue)),
        options_(options),
        strips_(std::move(strips)),
        ratio_(queue_.kernel("modulus", "reference_stress", Precision::kFloat)),
        median_(queue_.kernel("modulus", "modulus_median", Precision::kFloat)) {}

  ModulusEstimate estimate(const ModulusInput& in) override {
    validate(in.force);
    const auto strip = strips_->get(in.tissue, in.window_width_m);
    const Measured& measured = in.measured;
    const OnDevice on_device{queue_.array(measured.axial_strain), queue_.array(measured.strain_valid)};
    ModulusEstimate out;
    out.absolute = in.force.has_value();
    const std::vector<bool> reached =
        this->reached(strip->model.on_image(strip->homogeneous.stress, measured.grid));
    StripResponse reference = strip->homogeneous;
    for (int correction = 0;; ++correction) {
      Field stress = strip->model.on_image(reference.stress, measured.grid);
      for (std::size_t n = 0; n < stress.size(); ++n)
        if (!reached[n]) stress[n] = std::numeric_limits<float>::quiet_NaN();
      // eps_yy ~ amplitude * stress over most of the window: E ~ E_background where that holds.
      const double amplitude = this->amplitude(measured, stress, out.mean_axial_strain);
      out.youngs_modulus = map(measured.grid, on_device, stress, amplitude,
                               force_scale(in, reference.force_n_per_m, amplitude));
      normalise(out);
      if (correction >= options_.corrections) return out;
      const KnownModulus& known = out.absolute ? in.known : kNothingKnown;
      reference = strip->model.solve(
          strip->model.on_elements(out.youngs_modulus, measured.grid, out.background, known));
    }
  }

 private:
  struct OnDevice {
    Array<float> axial_strain;
    Array<std::uint8_t> trusted;
  };

  // Where homogeneous tissue is strained enough to be judged.
  std::vector<bool> reached(const Field& homogeneous) const {
    std::vector<float> finite;
    std::copy_if(homogeneous.begin(), homogeneous.end(), std::back_inserter(finite),
                 [](float s) { return std::isfinite(s); });
    if (finite.empty())
      throw NoCompression("the frame shows nothing of the tissue; check depth_m and first_sample_depth_m");
    const double least = options_.min_reference * std::abs(median(finite));
    std::vector<bool> reached(homogeneous.size());
    for (std::size_t n = 0; n < reached.size(); ++n) reached[n] = std::abs(homogeneous[n]) >= least;
    return reached;
  }

  // Median of eps_yy over the reference's E eps_yy, over the trusted nodes.
  double amplitude(const Measured& measured, const Field& stress, double& mean_axial_strain) const {
    std::vector<float> ratios, axial;
    for (std::size_t n = 0; n < stress.size(); ++n) {
      if (!measured.strain_valid[n] || !std::isfinite(stress[n])) continue;
      axial.push_back(measured.axial_strain[n]);
      ratios.push_back(measured.axial_strain[n] / stress[n]);
    }
    mean_axial_strain = mean_strain(std::move(axial));
    return median(ratios);
  }

  Field map(const ImageGrid& grid, const OnDevice& measured, const Field& stress, double amplitude,
            double scale) {
    const Array<float> reference = queue_.array(stress), raw = queue_.array<float>(grid.size()),
                       smooth = queue_.array<float>(grid.size());
    const auto nx = static_cast<int>(grid.nx), ny = static_cast<int>(grid.ny);
    const double rows = (kUnsaidDepthM - grid.origin_y_m) / grid.dy_m;
    const int first_row = std::max(0, static_cast<int>(std::ceil(rows)));
    ratio_(over(grid.size()), measured.axial_strain, measured.trusted, reference, raw, nx, ny,
           static_cast<float>(amplitude), static_cast<float>(scale), static_cast<float>(kMinStrain),
           static_cast<float>(kRange), first_row);
    median_(over(grid.size()), raw, smooth, nx, ny, kMedianRadius);
    return queue_.read(smooth);
  }

  Queue queue_;
  ReferenceStressOptions options_;
  std::shared_ptr<StripCache> strips_;
  Kernel ratio_, median_;
};

}  // namespace

std::unique_ptr<ModulusMethod> make_reference_stress(Queue queue, ReferenceStressOptions options,
                                                     std::shared_ptr<StripCache> strips) {
  return std::make_unique<ReferenceStress>(std::move(queue), options, std::move(strips));
}

}  // namespace teletact::service
