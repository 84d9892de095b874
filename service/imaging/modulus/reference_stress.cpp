#include "service/imaging/modulus/modulus.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/imaging/modulus/seed.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr std::size_t kModulusGroup = 32;  // WORK_GROUP of modulus.cl

class ReferenceStress : public ModulusMethod {
 public:
  ReferenceStress(Queue queue, ReferenceStressOptions options, std::shared_ptr<StripCache> strips)
      : queue_(std::move(queue)),
        options_(options),
        strips_(strips ? std::move(strips) : std::make_shared<StripCache>()),
        ratio_(queue_.kernel("modulus", "reference_stress", Precision::kFloat)),
        median_(queue_.kernel("modulus", "modulus_median", Precision::kFloat)) {
    if (!(options_.min_strain > 0)) throw std::invalid_argument("min_strain: must be above 0");
    if (!(options_.min_reference >= 0 && options_.min_reference < 1))
      throw std::invalid_argument("min_reference: must be 0 or more and below 1");
    if (!(options_.range > 1)) throw std::invalid_argument("range: must be above 1");
    if (options_.corrections < 0 || options_.corrections > 20)
      throw std::invalid_argument("corrections: must be 0 to 20");
    if (options_.median_radius < 1 || options_.median_radius > 2)
      throw std::invalid_argument("median_radius: must be 1 or 2 nodes");
  }

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
      out.youngs_modulus = map(measured.grid, on_device, stress, amplitude, scale(in, reference, amplitude));
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

  // E where eps_yy = amplitude * stress: P / (P_ref |amplitude|), P per metre of thickness; 1 without a
  // force.
  static double scale(const ModulusInput& in, const StripResponse& reference, double amplitude) {
    if (!in.force) return 1;
    const double force_n_per_m = in.force->force_n / in.force->contact_area_m2 * in.window_width_m;
    return force_n_per_m / (reference.force_n_per_m * std::abs(amplitude));
  }

  // Median of eps_yy over the reference's E eps_yy, over the trusted nodes.
  double amplitude(const Measured& measured, const Field& stress, double& mean_axial_strain) const {
    std::vector<float> ratios, axial;
    for (std::size_t n = 0; n < stress.size(); ++n) {
      if (!measured.strain_valid[n] || !std::isfinite(stress[n])) continue;
      axial.push_back(measured.axial_strain[n]);
      ratios.push_back(measured.axial_strain[n] / stress[n]);
    }
    if (axial.empty())
      throw NoCompression("no node of the strain map can be trusted inside the tissue; check depth_m");
    mean_axial_strain = median(axial);
    if (!(std::abs(mean_axial_strain) >= options_.min_strain))
      throw NoCompression(fmt::format(
          "the median axial strain is {:.3g} %, less than {:.3g} %: press further between the frames",
          100 * mean_axial_strain, 100 * options_.min_strain));
    return median(ratios);
  }

  Field map(const ImageGrid& grid, const OnDevice& measured, const Field& stress, double amplitude,
            double scale) {
    const Array<float> reference = queue_.array(stress), raw = queue_.array<float>(grid.size()),
                       smooth = queue_.array<float>(grid.size());
    const auto nx = static_cast<int>(grid.nx), ny = static_cast<int>(grid.ny);
    const double rows = (options_.near_field_m - grid.origin_y_m) / grid.dy_m;
    const int first_row = std::max(0, static_cast<int>(std::ceil(rows)));
    const Range range{{grid.size(), 1, 1}, {kModulusGroup, 1, 1}};
    ratio_(range, measured.axial_strain, measured.trusted, reference, raw, nx, ny,
           static_cast<float>(amplitude), static_cast<float>(scale),
           static_cast<float>(options_.min_strain), static_cast<float>(options_.range), first_row);
    median_(range, raw, smooth, nx, ny, options_.median_radius);
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
