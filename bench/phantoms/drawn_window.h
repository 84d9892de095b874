// Windows of tissue that are drawn at random, as displacement, strain and force for the modulus methods (T3),
// without RF: where the deviations that come with a modulus are judged over many seeds. The displacement is
// that of the plain finite elements of tests/reference on squares of about 0.5 mm, off the product's nodes.
#pragma once

#include <cstdint>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/modulus/modulus.h"

namespace teletact::bench {

// A lump in the middle 40 mm of a probe of 60 mm on tissue 160 mm wide.
struct DrawnCase {
  double contrast = 3, diameter_m = 0.010;
  double strain = 0.01;     // compression over depth
  double noise_m = 0.5e-6;  // standard deviation of the axial displacement, as tracking states it
  bool texture = true;      // ln E also varies as the iterative method's prior says, given the lump (T3.5)
  double depth_m = 0.040;   // of the tissue, up to that of the image
  bool operator==(const DrawnCase&) const = default;
};

class DrawnWindow {
 public:
  static constexpr double kWindowM = 0.060, kTissueM = 0.160, kBackgroundPa = 10e3;

  // The lump's place, the texture and the noise are the seed's.
  DrawnWindow(const DrawnCase&, std::uint64_t seed, service::Queue);
  service::ModulusInput input() const;
  // ln E of the tissue at a node of the image.
  double log_modulus(std::size_t node) const;
  // Of a node from the lump's edge, m; < 0 inside.
  double from_edge_m(std::size_t node) const;
  const service::ImageGrid& grid() const { return measured_.grid; }
  const std::vector<double>& texture() const { return texture_; }  // of the strip's elements

 private:
  double lump(double x_m, double y_m) const;  // ln E over the background
  double log_modulus(double x_m, double y_m) const;
  void draw_texture(std::uint64_t seed);
  std::vector<double> press();  // axial displacement at the image's nodes
  void measure(const service::Queue&, std::vector<double> axial, std::uint64_t seed);

  DrawnCase of_;
  double x_m_, y_m_;  // of the lump, window coordinates
  service::TissueExtent tissue_;
  service::ProbeForce force_;
  service::TissueGrid strip_;
  std::vector<double> texture_;
  service::Measured measured_;
};

}  // namespace teletact::bench
