// The parts of the elastography chart (suite elastography.cpp): what is run, measured, promised and drawn. SI
// units.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bench/device_figures.h"
#include "bench/peers/tracker.h"
#include "bench/phantoms/metrics.h"
#include "bench/phantoms/phantom.h"
#include "bench/suite.h"
#include "bench/windows_beside_touch.h"

namespace teletact::bench {

constexpr double kKernelLateralM = 2.0e-3;  // of the strain, for all
// Axial lengths of the strain kernel, odd numbers of nodes.
std::vector<double> strain_kernels_m();
constexpr double kEdgeM = 2.0e-3;  // the edge width at which SNRe and CNRe are compared

// Ours first, then others', ready to track.
struct Trackers {
  // All search as far as the product's default (5 %) of compression asks for; `wide` as far as kWideStrain.
  std::vector<Tracker> usual, wide;
  const Tracker& of(std::size_t method, const PhantomCase&) const;
};
Trackers make_trackers(const std::shared_ptr<service::Device>&);
// What all are told to search for above the product's default of compression, the others at it too: tissue
// strains by more at places, which their search does not allow for and ours does.
constexpr double kWideStrain = 0.10;
double max_strain_of(const PhantomCase&, bool ours);

// One method on one pair.
struct SeedFigures {
  double seconds = 0;
  double processor_s = 0;  // of all threads: ours runs on every core, the others on one
  TrackErrors errors;
  std::vector<StrainQuality> strain;  // [kernel]
};

struct TrackerFigures {
  std::string method;
  bool ours = false;
  std::vector<EdgeWidth> edges{};  // [kernel]
  bool edges_of_middle = false;
  std::vector<SeedFigures> seeds{};
  // One figure of every seed, NaN left out.
  template <class Figure>
  std::vector<double> over_seeds(Figure figure) const {
    std::vector<double> values;
    for (const SeedFigures& seed : seeds)
      if (const double v = figure(seed); std::isfinite(v)) values.push_back(v);
    return values;
  }
  // SNRe or CNRe by the edge width instead of by the kernel: of the kernels on both sides of kEdgeM, linear
  // in the logarithm; NaN where the method does not come so sharp or so smooth with these kernels. Of every
  // seed; NaN stays, so that seeds of two methods pair.
  std::vector<double> at_edge(double StrainQuality::*figure) const;
};

// Deviation of the default's standardised errors of every seed; its root mean square and 95 % interval.
struct Spread {
  std::vector<double> seeds;
  double rms = 0, low = 0, high = 0;
};
struct CalibrationFigures {
  Spread inside, outside;
};

// A phantom, the curves that it lies on ("middle", "strain", "snr", "correlation", "contrast", "diameter"),
// bounds, and every method on it.
struct Condition {
  PhantomCase of;
  std::vector<std::string> factors;
  double max_strain = 0, peers_max_strain = 0;
  double bound_m = 0, window_bound_m = 0, filter_snre = 0, companded_filter_snre = 0;
  CalibrationFigures calibration{};
  std::vector<TrackerFigures> methods{};
  bool on(const std::string& factor) const {
    return std::find(factors.begin(), factors.end(), factor) != factors.end();
  }
};

struct NamedImage {
  std::string title;
  std::vector<double> values;  // of every node, NaN for none
};
// Strain of the middle's first seed, the truth first.
struct StrainImages {
  service::ImageGrid grid;
  double kernel_m = 0;
  std::vector<NamedImage> strain;
};

struct RigidPhase {
  double shift_m = 0, rmse_m = 0, bias_m = 0;
};
struct RigidMethod {
  std::string method;
  bool ours = false;
  std::vector<RigidPhase> phases{};
};
struct RigidFigures {
  double bound_m = 0, independent_lines = 0;
  std::vector<RigidMethod> methods{};
};

struct ModulusSeed {
  std::string failed;  // why there is no map
  double seconds = 0, displacement_s = 0, strain_s = 0;
  ModulusQuality quality{};
};
struct ModulusMethodFigures {
  std::string method;
  bool ours = false;
  std::vector<ModulusSeed> seeds{};
  std::vector<double> image{};  // of the first seed
};
struct ModulusCase {
  double contrast = 0, diameter_m = 0;
  std::vector<ModulusMethodFigures> methods{};
};
struct ModulusFigures {
  double background_pa = 0;
  std::string judged = "nodes of which every method says something, and all within 1.3 radii";
  std::vector<ModulusCase> cases{};
};

struct StageFigures {
  WindowTimes direct, iterative;  // beside a touch stream
};

// Where a method stops working along a factor.
struct Failure {
  std::string method;
  PhantomCase of;
  std::string why;
};
// Where a method has no SNRe at the edge width of the comparison at some seeds.
struct WithoutFigure {
  std::string method;
  PhantomCase of;
  std::size_t seeds = 0, of_seeds = 0;
};

struct ElastographyFigures {
  double edge_m = kEdgeM;
  std::string edge_rule =
      "SNRe and CNRe between the two kernels whose axial edge width brackets edge_m; a peer whose edge "
      "cannot "
      "be read has the middle's (edges_of_middle), which favours it; a method without a figure "
      "(without_figure) loses the point";
  std::vector<double> kernels_m = strain_kernels_m();
  double kernel_lateral_m = kKernelLateralM;
  DeviceFigures device{};
  std::string threads = "host methods on one thread, ours on the whole device";
  RigidFigures rigid{};
  std::vector<Condition> conditions{};
  StrainImages images{};
  std::vector<Failure> failures{};
  std::vector<WithoutFigure> without_figure{};
  ModulusFigures modulus{};
  StageFigures stages{};
  std::map<std::string, double> elapsed_s{};  // of each part
  const Condition& middle() const { return conditions.at(0); }
};

// The middle first.
std::vector<Condition> measure_conditions(const Trackers&, bool quick, StrainImages&);
// Shifts in parts of a sample.
RigidFigures measure_rigid(const Trackers&, bool quick);
ModulusFigures measure_modulus(const std::shared_ptr<service::Device>&, bool quick);
StageFigures measure_stages(const std::shared_ptr<service::Device>&, bool quick);

std::vector<Failure> failures(const std::vector<Condition>&);
std::vector<WithoutFigure> without_figure(const std::vector<Condition>&);

// Acceptance lines that there are figures for.
void add_elastography_promises(const ElastographyFigures&, Promises&);
void add_modulus_promises(const ModulusFigures&, Promises&);

void draw_elastography(const ElastographyFigures&, const std::filesystem::path& folder);
void draw_modulus(const ElastographyFigures&, const std::filesystem::path& folder);
// In rows of three, x and y in mm; values times `scale`, `settings` of gnuplot.
void draw_images(const service::ImageGrid&, const std::vector<NamedImage>&, double scale,
                 const std::string& settings, const std::filesystem::path& file);

}  // namespace teletact::bench
