// The real transforms of solids there and back, ours beside VkFFT's. In a solver ours are part of other
// kernels.
#include <cmath>
#include <cstdio>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/peers/vkfft.h"
#include "bench/solid_blocks.h"
#include "bench/suites/device/device.h"
#include "service/solver/fourier.h"

namespace teletact::bench {
namespace {

double ours_s(const service::Queue& queue, std::size_t nx, std::size_t nz, std::size_t planes) {
  service::Fourier<float> fourier(queue, nx, nz, planes);
  std::vector<float> values(fourier.field_size());
  for (std::size_t k = 0; k < values.size(); ++k) values[k] = std::sin(0.1F * static_cast<float>(k % 1000));
  service::Array<float> field = queue.array(values), spectrum = queue.array<float>(fourier.spectrum_size());
  constexpr int kRounds = 16, kOfARound = 10;
  std::vector<double> s;
  for (int round = 0; round < kRounds; ++round)
    s.push_back(seconds_of([&] {
                  for (int k = 0; k < kOfARound; ++k) {
                    fourier.forward(field, spectrum, 0, planes);
                    fourier.backward(spectrum, field, 0, planes);
                  }
                  queue.finish();
                }) /
                kOfARound);
  s.erase(s.begin());  // the first compiles
  return median_of(s);
}

}  // namespace

void measure_transforms(DevicePart& part) {
  const auto device = part.open();
  std::vector<service::SolidGrid> grids{solid_grid(32, 16, 8, 0.004, 0.004)};
  if (!part.quick) grids.insert(grids.end(), {solid_70k(), solid_336k()});
  for (const service::SolidGrid& grid : grids) {
    const std::size_t planes = 3 * grid.layers();
    TransformsFigures f{std::to_string(grid.nx) + " x " + std::to_string(grid.nz) + ", " +
                        std::to_string(planes) + " planes"};
    f.ours_ms = 1e3 * ours_s(device->queue(), grid.nx, grid.nz, planes);
    const auto rival = measure_vkfft(device->info().name, grid.nx, grid.nz, planes, f.absent);
    if (rival) f.vkfft_ms = 1e3 * rival->s, f.vkfft_off = rival->off;
    part.add("transforms", f);
    std::printf("transforms, %s: %.3f ms; %s\n", f.transform.c_str(), f.ours_ms,
                rival ? ("VkFFT " + std::to_string(f.vkfft_ms) + " ms").c_str() : f.absent.c_str());
    std::fflush(stdout);
  }
}

}  // namespace teletact::bench
