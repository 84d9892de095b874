// What the mesh itself is off by: one tip, pressed 1 mm beside the middle, on finer and finer meshes; force
// and displacement of the surface against those of the finest.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "bench/basics/clock.h"
#include "bench/suites/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kPlaces = 31;  // of the surface, nodes of every mesh
constexpr double kTipRadiusM = 0.030, kIndentationM = 0.001, kPlaceM = 0.031;

struct MeshAnswer {
  double force_n = 0, ready_s = 0;
  std::size_t touched = 0;
  Eigen::VectorXd displacement_m;  // axial, at kPlaces
};

MeshAnswer answer_on(const ContactCase& c) {
  const reference::TouchedTissue tissue = make_tissue(c);
  MeshAnswer answer;
  const service::TissueGrid& grid = tissue.grid;
  const auto begin = Clock::now();
  const service::TissueModel model(grid, tissue.material, tissue.supports, {});
  answer.ready_s = seconds_since(begin);
  const auto surface = model.compliance(0);
  const auto touch = service::solve_contact(model.problem(), 0, *surface, {.radius_m = kTipRadiusM},
                                            {kPlaceM, kIndentationM});
  answer.force_n = touch.force_n[1];
  answer.touched = touch.pressure.size();
  std::vector<std::size_t> nodes(grid.nx());
  for (std::size_t i = 0; i < nodes.size(); ++i) nodes[i] = i;
  Eigen::VectorXd push = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(nodes.size()));
  for (const service::NodalPressure& p : touch.pressure) {
    const auto i = std::lower_bound(grid.x_m.begin(), grid.x_m.end(), p.position_m[0]) - grid.x_m.begin();
    const double left = grid.x_m[std::size_t(i ? i - 1 : 0)];
    const double right = grid.x_m[std::min(std::size_t(i) + 1, grid.nx() - 1)];
    push[i] = p.pressure_pa * (right - left) / 2;
  }
  const Eigen::VectorXd u = surface->axial_among(nodes, nullptr) * push;
  answer.displacement_m.resize(kPlaces);
  for (std::size_t k = 0; k < kPlaces; ++k)
    answer.displacement_m[Eigen::Index(k)] = u[Eigen::Index(k * (grid.nx() - 1) / (kPlaces - 1))];
  return answer;
}

}  // namespace

std::vector<ConvergenceFigures> measure_convergence(bool quick) {
  const std::vector<std::size_t> columns =
      quick ? std::vector<std::size_t>{31, 61, 121} : std::vector<std::size_t>{31, 61, 121, 241};
  std::vector<ConvergenceFigures> all;
  for (const auto& [pattern, contrast] : {std::pair{Pattern::kNodule, 1.0},
                                          {Pattern::kNodule, 10.0},
                                          {Pattern::kLayered, 10.0},
                                          {Pattern::kCheckerboard, 10.0}}) {
    ContactCase c;
    c.pattern = pattern;
    c.contrast = contrast;
    c.columns = c.rows = 2 * (columns.back() - 1) + 1;
    const MeshAnswer finest = answer_on(c);
    all.push_back({to_string(pattern), contrast, c.columns});
    for (const std::size_t size : columns) {
      c.columns = c.rows = size;
      const MeshAnswer a = answer_on(c);
      const MeshFigures m{size, a.touched, a.ready_s, std::abs(a.force_n / finest.force_n - 1),
                          (a.displacement_m - finest.displacement_m).lpNorm<Eigen::Infinity>() /
                              finest.displacement_m.lpNorm<Eigen::Infinity>()};
      std::printf("mesh %3zux%zu %s contrast %g: force off by %.2f %%, displacement by %.2f %%\n", size, size,
                  to_string(pattern), contrast, 100 * m.force_error, 100 * m.displacement_error);
      all.back().meshes.push_back(m);
    }
  }
  return all;
}

}  // namespace teletact::bench
