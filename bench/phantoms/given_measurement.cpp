#include "bench/phantoms/given_measurement.h"

#include <algorithm>
#include <memory>
#include <random>

namespace teletact::bench {
namespace {

constexpr double kMinStatedM = 0.3e-6;
constexpr double kLateralNoise = 10;  // over the axial

// White noise over 3 x 3 nodes, the area that errors of tracking agree over.
std::vector<double> smooth_noise(const service::ImageGrid& grid, double size_m, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const std::size_t wide = grid.nx + 2;
  std::vector<double> white(wide * (grid.ny + 2)), out(grid.size());
  for (double& w : white) w = normal(random);
  for (std::size_t n = 0; n < grid.size(); ++n)
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t a = 0; a < 3; ++a)
        out[n] += size_m / 3 * white[n % grid.nx + a + wide * (grid.row(n) + b)];
  return out;
}

}  // namespace

service::Measured measured_of(const service::Queue& queue, const GivenDisplacement& given,
                              std::uint64_t seed) {
  const service::ImageGrid& image = given.image;
  std::mt19937_64 random(seed);
  const std::vector<double> noise = smooth_noise(image, given.noise_m, random),
                            lateral = smooth_noise(image, kLateralNoise * given.noise_m, random);
  const double stated_m = std::max(given.noise_m, kMinStatedM),
               size_m[] = {kLateralNoise * stated_m, stated_m};
  std::vector<float> field, std_m;
  for (std::size_t n = 0; n < image.size(); ++n) {
    field.push_back(static_cast<float>(given.lateral_m.at(n) + lateral[n]));
    field.push_back(static_cast<float>(given.axial_m.at(n) + noise[n]));
    for (const double s : size_m) std_m.push_back(static_cast<float>(s));
  }
  constexpr double kInformation = 1;
  auto structure = std::make_shared<service::NoiseStructure>();
  for (std::size_t c = 0; c < 2; ++c) {
    structure->response[c] =
        service::NoiseResponse(service::SmootherResponse{1, 1, 3, 1}, kInformation, 1, 1);
    const service::DeviationTable whole = structure->response[c].deviation();
    structure->unit_m[c] = size_m[c] / static_cast<double>(whole[service::kBelowMedian]);
  }
  service::DisplacementEstimate displacement;
  displacement.grid.nx = static_cast<int>(image.nx), displacement.grid.ny = static_cast<int>(image.ny);
  displacement.field_m = queue.array(field);
  displacement.trusted =
      queue.array(given.trusted.empty() ? std::vector<std::uint8_t>(image.size(), 1) : given.trusted);
  displacement.correlation = queue.array(std::vector<float>(image.size(), 1));
  displacement.std_m = queue.array(std_m);
  displacement.information =
      queue.array(std::vector<float>(2 * image.size(), static_cast<float>(kInformation)));
  displacement.noise = structure;
  service::Measured measured;
  measured.grid = image;
  service::download(queue, displacement, measured);
  service::download(queue, service::StrainEstimator(queue, {}).estimate(displacement, image), measured);
  return measured;
}

}  // namespace teletact::bench
