// The parts of the contact chart (suite contact.cpp): what is run, measured, promised and drawn.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "bench/device_figures.h"
#include "bench/peers/peer.h"
#include "bench/suite.h"

namespace teletact::bench {

constexpr double kForceGoal =
    1e-6;  // every method is timed at the loosest setting that gets the force so well

// A case and the charts that it belongs to: "base", "size", "poisson", "contrast", "pattern", "robustness".
struct ChartCase {
  ContactCase of;
  std::vector<std::string> sweeps;
  bool only_device_pcg = false;  // for its iterations
};
std::vector<ChartCase> chart_cases(bool quick);

// One tolerance that an iterative method was tried at.
struct Rung {
  double tolerance = 0, seconds = 0;
  std::size_t iterations = 0;
  double force_error = 0;
};

// One method on one case. A figure that the method has none of has a count of 0, or is 0.
struct MethodFigures {
  std::string method;
  bool ours = false, iterative = false, products_choice = false;
  std::string declined{}, failed{};  // why nothing was measured
  Quantiles setup_s{}, touch_s{}, surface_s{}, one_solve_s{};
  double kept_bytes_per_unknown = 0, tolerance = 0;
  std::size_t iterations = 0;
  double force_error = 0, displacement_error = 0, stated_error = 0;
  bool goal_met = false;
  std::vector<Rung> ladder{};
  bool measured() const { return touch_s.count > 0; }
  double cold_s() const { return setup_s.p50 + touch_s.p50; }  // set-up and touch together
};

// One touch as the product does it by conjugate gradients: columns of the compliance, its own precision and
// tolerance.
struct ColumnFigures {
  std::string failed;
  std::size_t iterations = 0;
  bool converged = false;
  double stated_error = 0, force_error = 0;
};

struct CaseFigures {
  std::vector<std::string> sweeps;
  std::size_t columns = 0, rows = 0;
  double poisson_ratio = 0, contrast = 0;
  std::string pattern;
  double stretch = 0;
  std::size_t unknowns = 0, contact_nodes = 0;
  double tip_radius_m = 0;
  std::vector<MethodFigures> methods{};
  ColumnFigures by_columns{};
  bool in(const std::string& sweep) const {
    return std::find(sweeps.begin(), sweeps.end(), sweep) != sweeps.end();
  }
};

// Of the condensed touch: all layers, the window's tissue, tangent, work around a loop, ripple; of the
// device: a moving finger.
struct LayerFigures {
  Quantiles surface_s, all_layers_s;
};
struct WindowTissueFigures {
  std::size_t columns = 0, rows = 0;
  Quantiles ready_s, refreshed_s;
  double refreshed_difference = 0;
};
struct Ripple {
  double secant = 0, tangent = 0;
};
struct PathFigures {
  double first_patch_s = 0, warm_mean_s = 0;
  Quantiles warm_s, solving_s;
  double largest_force_error = 0;
};
struct ProductFigures {
  LayerFigures layers;
  WindowTissueFigures window_tissue;
  double tangent_error = 0, loop_work = 0;
  Ripple ripple;
  PathFigures path;
};

// One tip on one mesh, against a mesh twice as fine as the finest of them.
struct MeshFigures {
  std::size_t columns = 0, touched_nodes = 0;
  double ready_s = 0, force_error = 0, displacement_error = 0;
};
struct ConvergenceFigures {
  std::string pattern;
  double contrast = 0;
  std::size_t finest_columns = 0;
  std::vector<MeshFigures> meshes{};
};

struct ContactFigures {
  double force_goal = kForceGoal;
  std::vector<std::string> absent;
  DeviceFigures device;
  std::string threads = "host methods and their BLAS on one thread, device methods on the whole device";
  std::vector<CaseFigures> cases{};
  ProductFigures product{};
  std::vector<ConvergenceFigures> convergence{};
};

// Checks, then times one method on one case.
MethodFigures measure_method(Peer&, const ContactProblem&, bool whole_ladder, bool quick);
ColumnFigures measure_columns(const ContactProblem&, const std::shared_ptr<service::Device>&);
ProductFigures measure_product(const ContactProblem& base, const std::shared_ptr<service::Device>&,
                               bool quick);
std::vector<ConvergenceFigures> measure_convergence(bool quick);

// Acceptance lines that there are figures for.
void add_contact_promises(const ContactFigures&, Promises&);
void draw_contact(const ContactFigures&, const std::filesystem::path& folder);

// Slope of log y over log x by least squares; NaN for fewer than two points.
double log_slope(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace teletact::bench
