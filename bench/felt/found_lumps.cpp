#include "bench/felt/found_lumps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "bench/basics/median.h"
#include "bench/suite.h"
#include "client/report/nearest_matches.h"

namespace teletact::bench {
namespace {

constexpr double kStepM = 0.001, kSmallestM = 0.005;

// ln E, straight between the middles of elements; those of missing slices are left out.
class Logarithms {
 public:
  explicit Logarithms(const client::MetaImage& image) : image_(image), values_(image.as<float>()) {
    if (image.size.size() != 3 || image.channels != 1 || image.spacing.size() != 3 ||
        image.origin.size() != 3)
      throw BenchError("the volume of moduli has three dimensions, a spacing and an origin");
    const std::size_t plane = image.size[0] * image.size[1];
    for (std::size_t k = 0; k < image.size[2]; ++k)
      if (std::isfinite(values_[k * plane])) slices_.push_back(k);
    if (slices_.empty()) throw BenchError("the volume of moduli has no slice");
    for (float& value : values_) value = std::log(value);
  }
  std::vector<double> known() const {
    std::vector<double> out;
    for (const float value : values_)
      if (std::isfinite(value)) out.push_back(value);
    return out;
  }
  double z_m(std::size_t slice) const {
    return image_.origin[2] + image_.spacing[2] * double(slices_[slice]);
  }
  double first_z_m() const { return z_m(0); }
  double last_z_m() const { return z_m(slices_.size() - 1); }
  double size_m(std::size_t axis) const { return image_.spacing[axis] * double(image_.size[axis]); }
  double at(double x_m, double y_m, double z) const {
    std::size_t after = 0;
    while (after + 1 < slices_.size() && z_m(after) < z) ++after;
    const std::size_t before = after > 0 ? after - 1 : 0;
    const double apart_m = z_m(after) - z_m(before);
    const double share = apart_m > 0 ? std::clamp((z - z_m(before)) / apart_m, 0.0, 1.0) : 0;
    return (1 - share) * in_slice(slices_[before], x_m, y_m) + share * in_slice(slices_[after], x_m, y_m);
  }

 private:
  double in_slice(std::size_t k, double x_m, double y_m) const {
    const auto place = [&](std::size_t axis, double at_m) {
      const double n =
          std::clamp((at_m - image_.origin[axis]) / image_.spacing[axis], 0.0, double(image_.size[axis] - 1));
      const auto first = std::min(std::size_t(n), image_.size[axis] - 2);
      return std::pair(first, n - double(first));
    };
    const auto [i, p] = place(0, x_m);
    const auto [j, q] = place(1, y_m);
    const auto value = [&](std::size_t a, std::size_t b) {
      return double(values_[a + image_.size[0] * (b + image_.size[1] * k)]);
    };
    return (1 - q) * ((1 - p) * value(i, j) + p * value(i + 1, j)) +
           q * ((1 - p) * value(i, j + 1) + p * value(i + 1, j + 1));
  }
  const client::MetaImage& image_;
  std::vector<float> values_;
  std::vector<std::size_t> slices_;
};

// Points kStepM apart.
struct Points {
  std::array<std::size_t, 3> size{};
  double first_z_m = 0;
  std::vector<double> log_contrast;
  std::array<double, 3> at_m(std::size_t n) const {
    const std::size_t i = n % size[0], j = n / size[0] % size[1], k = n / size[0] / size[1];
    return {kStepM * (double(i) + 0.5), kStepM * (double(j) + 0.5), first_z_m + kStepM * double(k)};
  }
};

Points points_of(const Logarithms& logarithms, double background) {
  Points p;
  p.first_z_m = logarithms.first_z_m();
  for (const std::size_t axis : {0, 1}) p.size[axis] = std::size_t(logarithms.size_m(axis) / kStepM + 0.5);
  p.size[2] = std::size_t((logarithms.last_z_m() - p.first_z_m) / kStepM + 0.5) + 1;
  for (std::size_t n = 0; n < p.size[0] * p.size[1] * p.size[2]; ++n) {
    const auto [x, y, z] = p.at_m(n);
    p.log_contrast.push_back(logarithms.at(x, y, z) - background);
  }
  return p;
}

// Of the points that touch `seed`, all above; they are taken out.
std::vector<std::size_t> take_component(const Points& p, std::size_t seed, std::vector<char>& above) {
  std::vector<std::size_t> points{seed};
  above[seed] = 0;
  const std::array<std::size_t, 3> step{1, p.size[0], p.size[0] * p.size[1]};
  for (std::size_t n = 0; n < points.size(); ++n)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t place = points[n] / step[axis] % p.size[axis];
      const auto visit = [&](bool inside, std::size_t point) {
        if (inside && above[point]) above[point] = 0, points.push_back(point);
      };
      visit(place > 0, points[n] - step[axis]);
      visit(place + 1 < p.size[axis], points[n] + step[axis]);
    }
  return points;
}

FoundLump measure(const Points& p, const std::vector<std::size_t>& points) {
  FoundLump lump;
  for (const std::size_t n : points) {
    const auto [x, y, z] = p.at_m(n);
    const double share = 1 / double(points.size());
    lump.x_m += share * x, lump.y_m += share * y, lump.z_m += share * z;
    lump.contrast = std::max(lump.contrast, std::exp(p.log_contrast[n]));
  }
  lump.diameter_m = kStepM * std::cbrt(6 * double(points.size()) / std::numbers::pi);
  return lump;
}

}  // namespace

LumpReport find_lumps(const client::MetaImage& volume, const std::vector<client::Inclusion>& truth) {
  const Logarithms logarithms(volume);
  LumpReport report;
  const double background = median_of(logarithms.known());
  report.background_pa = std::exp(background);
  const Points points = points_of(logarithms, background);
  const double least = std::log(3.0) / 2;
  std::vector<char> above;
  for (const double value : points.log_contrast) above.push_back(value >= least);
  for (std::size_t n = 0; n < above.size(); ++n)
    if (above[n])
      if (const FoundLump lump = measure(points, take_component(points, n, above));
          lump.diameter_m >= kSmallestM)
        report.found.push_back(lump);
  client::NearestMatches matches = client::nearest_matches(
      truth.size(), report.found.size(), kLumpMatchM, [&](std::size_t t, std::size_t f) {
        const FoundLump& lump = report.found[f];
        return std::hypot(truth[t].x_m - lump.x_m, truth[t].y_m - lump.y_m, truth[t].z_m - lump.z_m);
      });
  report.match = std::move(matches.of_truth), report.invented = std::move(matches.unmatched);
  return report;
}

}  // namespace teletact::bench
