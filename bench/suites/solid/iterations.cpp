// Iterations to an error of the energy norm of 1e-3 and 1e-6: true, against a converged solution, and by what
// is certified. In double, a Hertzian load over a lump.
#include <fmt/format.h>

#include <cstdio>

#include "bench/curves.h"
#include "bench/solid_blocks.h"
#include "bench/suites/solid/solid.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::bench {
namespace {

constexpr double kCoarse = 1e-3, kFine = 1e-6;

struct Iterations {
  std::string shape;
  std::size_t nodes = 0;
  double poisson_ratio = 0, contrast = 1, texture = 0;
  std::size_t true_1e_3 = 0, true_1e_6 = 0, certified_1e_3 = 0, certified_1e_6 = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Iterations, shape, nodes, poisson_ratio, contrast, texture, true_1e_3,
                                   true_1e_6, certified_1e_3, certified_1e_6)

struct Figures {
  std::vector<Iterations> lumps{};   // by size: "13 k", "70 k", "336 k"
  std::vector<Iterations> shapes{};  // textures, few elements along z, long ones
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, lumps, shapes)

Iterations count(const service::Queue& queue, const std::string& shape, const service::SolidGrid& grid,
                 double nu, double contrast, double texture = 0) {
  Iterations out{shape, grid.elements(), nu, contrast, texture};
  service::SolidSolver<double> solver(queue, solid_tissue(grid, nu, {.contrast = contrast}, texture));
  const SurfaceValues load = hertz_load(grid);
  const auto solve = [&](double relative_error, std::size_t most) {
    return solver.load(load.unknowns, load.values,
                       {.relative_error = relative_error, .max_iterations = most});
  };
  constexpr std::size_t kMax = 1000;
  const service::SolidSolution truth = solve(1e-9, kMax), fine = solve(kFine, kMax);
  if (truth.reason != service::StopReason::kConverged || !truth.certified)
    throw BenchError(fmt::format("{}, nu {}, contrast {}: not converged", shape, nu, contrast));
  out.certified_1e_6 = fine.iterations;
  out.certified_1e_3 = solve(kCoarse, kMax).iterations;
  // The error falls with every iteration, and is |u|^2 - |u_k|^2 squared.
  const auto first_within = [&](double error, std::size_t most) {
    std::size_t least = 0;
    while (least < most) {
      const std::size_t k = (least + most) / 2;
      const double left = 1 - solve(0, k).energy_j / truth.energy_j;
      (left <= error * error ? most : least) = left <= error * error ? k : k + 1;
    }
    return least;
  };
  out.true_1e_3 = first_within(kCoarse, out.certified_1e_3);
  out.true_1e_6 = first_within(kFine, out.certified_1e_6);
  std::printf("%-18s %7zu nodes  nu %-6g contrast %-4g texture %-3g  true %2zu/%2zu  certified %2zu/%2zu\n",
              shape.c_str(), out.nodes, nu, contrast, texture, out.true_1e_3, out.true_1e_6,
              out.certified_1e_3, out.certified_1e_6);
  return out;
}

void promise(const Figures& f, Promises& promises) {
  struct Bound {
    double contrast;
    std::size_t coarse, fine;
  };
  for (const Bound& b : {Bound{10, 10, 21}, {100, 27, 52}, {1000, 42, 90}}) {
    std::size_t coarse = 0, fine = 0;
    double spread = 0;
    const Iterations* middle = nullptr;
    for (const Iterations& i : f.lumps)
      if (i.shape == "70 k" && i.contrast == b.contrast && i.poisson_ratio == 0.49) middle = &i;
    for (const Iterations& i : f.lumps) {
      if (i.contrast != b.contrast || i.poisson_ratio > 0.49) continue;
      coarse = std::max(coarse, i.true_1e_3), fine = std::max(fine, i.true_1e_6);
      if (middle == nullptr || i.poisson_ratio != 0.49) continue;
      for (const auto member : {&Iterations::true_1e_3, &Iterations::true_1e_6}) {
        const double n = double(i.*member), there = double(middle->*member);
        spread = std::max(spread, std::abs(n - there) - (b.contrast < 1000 ? 0 : 0.15 * there));
      }
    }
    if (coarse == 0) continue;  // not run
    const std::string of = fmt::format("_contrast_{}", b.contrast);
    promises.push_back({"iterations_to_1e_3" + of, double(coarse), double(b.coarse)});
    promises.push_back({"iterations_to_1e_6" + of, double(fine), double(b.fine)});
    const char* beyond = b.contrast < 1000 ? "iterations_over_sizes_off_70_k"
                                           : "iterations_over_sizes_off_70_k_beyond_15_percent";
    if (middle != nullptr) promises.push_back({beyond + of, spread, 2});
  }
}

Figures measure(bool quick, Promises& promises) {
  const service::Queue queue = service::Device::open()->queue();
  Figures f;
  std::vector<std::pair<const char*, service::SolidGrid>> sizes{{"13 k", solid_13k()}, {"70 k", solid_70k()}};
  if (!quick) sizes.emplace_back("336 k", solid_336k());
  for (const auto& [name, grid] : sizes)
    for (const double contrast : {10.0, 100.0, 1000.0})
      if (!quick || contrast < 1000) f.lumps.push_back(count(queue, name, grid, 0.49, contrast));
  const auto& [name, grid] = sizes[quick ? 0 : 1];
  f.lumps.push_back(count(queue, name, grid, 0.49, 3));
  for (const double nu : {0.3, 0.4999})
    for (const double contrast : {3.0, 10.0, 100.0, 1000.0})
      if (!quick || contrast == 10) f.lumps.push_back(count(queue, name, grid, nu, contrast));
  for (const double nu : {0.3, 0.49, 0.4999}) {
    if (quick && nu != 0.49) continue;
    f.shapes.push_back(count(queue, std::string(name) + " texture", grid, nu, 1, 0.1));
    f.shapes.push_back(count(queue, std::string(name) + " texture", grid, nu, 1, 0.3));
    f.shapes.push_back(count(queue, std::string(name) + " both", grid, nu, 10, 0.1));
  }
  if (!quick)
    for (const double contrast : {10.0, 100.0}) {
      for (const std::size_t nz : {1, 4, 16})
        f.shapes.push_back(count(queue, fmt::format("2 mm, {} along z", nz),
                                 solid_grid(64, nz, 34, 0.002, 0.002), 0.49, contrast));
      f.shapes.push_back(count(queue, "2 x 4 mm", solid_grid(64, 16, 13, 0.002, 0.004), 0.49, contrast));
      f.shapes.push_back(
          count(queue, "64 x 64 mm of 1 mm", solid_grid(64, 64, 17, 0.001, 0.001), 0.49, contrast));
      f.shapes.push_back(count(queue, "4 mm", solid_grid(32, 16, 26, 0.004, 0.004), 0.49, contrast));
      f.shapes.push_back(
          count(queue, "64 x 32 mm of 2 mm", solid_grid(32, 16, 26, 0.002, 0.002), 0.49, contrast));
      f.shapes.push_back(count(queue, "1 x 4 mm", solid_grid(128, 16, 34, 0.001, 0.004), 0.49, contrast));
    }
  promise(f, promises);
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  std::vector<Curve> by_contrast, by_size;
  const auto curve = [](std::vector<Curve>& curves, const std::string& title) -> Curve& {
    for (Curve& c : curves)
      if (c.title == title) return c;
    return curves.emplace_back(Curve{.title = title});
  };
  std::vector<Iterations> lumps = f.lumps;
  std::stable_sort(lumps.begin(), lumps.end(),
                   [](const auto& a, const auto& b) { return a.contrast < b.contrast; });
  std::size_t charted = 0;  // the size with the most Poisson's ratios
  for (const Iterations& i : lumps)
    if (i.poisson_ratio != 0.49) charted = i.nodes;
  for (const Iterations& i : lumps) {
    if (i.nodes == charted) {
      curve(by_contrast, fmt::format("1e-3, nu {}", i.poisson_ratio)).add(i.contrast, double(i.true_1e_3));
      curve(by_contrast, fmt::format("1e-6, nu {}", i.poisson_ratio)).add(i.contrast, double(i.true_1e_6));
    }
    if (i.poisson_ratio == 0.49 && i.contrast > 3) {
      curve(by_size, fmt::format("1e-3, contrast {}", i.contrast)).add(double(i.nodes), double(i.true_1e_3));
      curve(by_size, fmt::format("1e-6, contrast {}", i.contrast)).add(double(i.nodes), double(i.true_1e_6));
    }
  }
  const std::string log = "set logscale x\nset yrange [0:*]\nset key top left\n";
  plot(folder / "solid_contrast.png",
       script_of(by_contrast, log + axes("A sphere of 12 mm, 12 mm deep", "contrast", "iterations")));
  plot(folder / "solid_size.png",
       script_of(by_size, log + axes("A sphere of 12 mm, 12 mm deep, nu 0.49", "nodes", "iterations")));
}

}  // namespace

Part solid_iterations() {
  return make_part("iterations", measure, draw);
}

}  // namespace teletact::bench
