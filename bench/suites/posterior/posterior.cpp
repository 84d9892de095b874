// teletact-bench posterior: whether the deviations that come with a modulus are what it is off by (T3.5).
//   prior: tissue drawn from the prior that the iterative method states, about a lump; displacement from
//     other finite elements with noise of the size that is stated
//   lumps: sharp lumps in even tissue, from simulated RF through the whole estimate
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/phantoms/drawn_window.h"
#include "bench/phantoms/phantom.h"
#include "bench/run_suite.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {
namespace {

constexpr double kRimM = 3e-3, kAwayM = 5e-3, kMeanM = 5e-3, kQuantile = 1.96;

// Of nodes of one kind.
struct Tally {
  double nodes = 0, squares = 0, covered = 0, deviation = 0, error = 0;
  void add(double error_of, double stated) {
    const double z = error_of / stated;
    ++nodes, squares += z * z, covered += std::abs(z) <= kQuantile, deviation += stated;
    error += error_of * error_of;
  }
  double standardised() const { return std::sqrt(squares / nodes); }
  double coverage() const { return covered / nodes; }
};

struct Row {
  std::string from;
  double contrast = 0, diameter_m = 0, strain = 0, snr_db = 0, noise_m = 0;
  // rms of (estimate - truth) / stated over all nodes; and over means of 5 mm
  double standardised = 0, standardised_means = 0;
  double inside = 0, rim = 0, outside = 0;  // share of nodes within 1.96 deviations
  double error = 0, deviation = 0;          // rms, mean; of all nodes
  double background_deviation = 0;          // median stated of means over 5 mm, 5 mm from the edge
  double correlation_m = 0, estimate_s = 0, modulus_s = 0;
  std::size_t seeds = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Row, from, contrast, diameter_m, strain, snr_db, noise_m, standardised,
                                   standardised_means, inside, rim, outside, error, deviation,
                                   background_deviation, correlation_m, estimate_s, modulus_s, seeds)
struct PosteriorFigures {
  std::vector<Row> rows;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PosteriorFigures, rows)

// An estimate beside its truth.
struct Judged {
  const service::ImageGrid& grid;
  const service::Field &modulus, &deviation;
  double correlation_m;
  std::function<double(std::size_t)> log_truth, from_edge_m;
};

class Cell {
 public:
  void add(const Judged& j) {
    for (std::size_t n = 0; n < j.grid.size(); ++n) {
      if (!std::isfinite(j.modulus[n])) continue;
      const double error = std::log(j.modulus[n]) - j.log_truth(n), off = j.from_edge_m(n);
      all_.add(error, j.deviation[n]);
      (off < 0 ? inside_ : outside_).add(error, j.deviation[n]);
      if (std::abs(off) < kRimM) rim_.add(error, j.deviation[n]);
    }
    add_means(j);
    correlations_.push_back(j.correlation_m);
  }
  void complete(Row& row) {
    row.standardised = all_.standardised(), row.standardised_means = means_.standardised();
    row.inside = inside_.coverage(), row.rim = rim_.coverage(), row.outside = outside_.coverage();
    row.error = std::sqrt(all_.error / all_.nodes), row.deviation = all_.deviation / all_.nodes;
    row.background_deviation = median_of(stated_means_), row.correlation_m = median_of(correlations_);
  }

 private:
  // Squares of 5 mm away from the edge, with the correlation that is stated.
  void add_means(const Judged& j) {
    const auto wide = static_cast<std::size_t>(kMeanM / j.grid.dx_m),
               high = static_cast<std::size_t>(kMeanM / j.grid.dy_m);
    for (std::size_t top = 0; top + high <= j.grid.ny; top += high)
      for (std::size_t left = 0; left + wide <= j.grid.nx; left += wide) {
        std::vector<std::size_t> nodes;
        for (std::size_t n = 0; n < wide * high; ++n)
          nodes.push_back(left + n % wide + j.grid.nx * (top + n / wide));
        if (std::any_of(nodes.begin(), nodes.end(), [&](std::size_t n) {
              return !std::isfinite(j.modulus[n]) || j.from_edge_m(n) < kAwayM;
            }))
          continue;
        double error = 0, variance = 0;
        for (const std::size_t a : nodes) {
          error += std::log(j.modulus[a]) - j.log_truth(a);
          for (const std::size_t b : nodes) {
            const double apart_m = std::hypot(j.grid.x_m(a) - j.grid.x_m(b), j.grid.y_m(a) - j.grid.y_m(b));
            variance += j.deviation[a] * j.deviation[b] * std::exp(-apart_m / j.correlation_m);
          }
        }
        const auto count = static_cast<double>(nodes.size());
        stated_means_.push_back(std::sqrt(variance) / count);
        means_.add(error / count, stated_means_.back());
      }
  }

  Tally all_, inside_, rim_, outside_, means_;
  std::vector<double> stated_means_, correlations_;
};

void print(const Row& r) {
  std::printf(
      "%-6s contrast %4.1f %4.1f mm %.0f %% %2.0f dB %.2f um: standardised %.2f, means %.2f; covered inside "
      "%.3f, rim "
      "%.3f, outside %.3f; off %.3f, stated %.3f; background %.3f; correlation %.1f mm; %.0f ms of %.0f\n",
      r.from.c_str(), r.contrast, 1e3 * r.diameter_m, 100 * r.strain, r.snr_db, 1e6 * r.noise_m,
      r.standardised, r.standardised_means, r.inside, r.rim, r.outside, r.error, r.deviation,
      r.background_deviation, 1e3 * r.correlation_m, 1e3 * r.modulus_s, 1e3 * r.estimate_s);
  std::fflush(stdout);
}

Row drawn(const std::shared_ptr<service::Device>& device, const DrawnCase& c, std::size_t seeds) {
  const service::Queue queue = device->queue();
  const auto strips = std::make_shared<service::StripCache>();
  const auto method = service::make_iterative(queue, strips);
  Row row{.from = "prior", .contrast = c.contrast, .diameter_m = c.diameter_m, .strain = c.strain};
  row.noise_m = c.noise_m, row.seeds = seeds;
  Cell cell;
  std::vector<double> seconds;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const DrawnWindow w(c, seed, queue);
    const service::ModulusInput in = w.input();
    service::ModulusEstimate e;
    seconds.push_back(seconds_of([&] { e = method->estimate(in), service::judge(in, *strips, e); }));
    cell.add({w.grid(), e.youngs_modulus, e.log_deviation, e.correlation_m,
              [&](std::size_t n) { return w.log_modulus(n); },
              [&](std::size_t n) { return w.from_edge_m(n); }});
    show_progress(fmt::format("drawn: seed {} of {}", seed, seeds));
  }
  row.modulus_s = median_of(seconds);
  cell.complete(row);
  print(row);
  return row;
}

Row from_rf(service::Elastography& elastography, Phantoms& phantoms, const PhantomCase& c,
            std::size_t seeds) {
  Row row{.from = "lumps", .contrast = c.contrast, .diameter_m = c.diameter_m, .strain = c.strain};
  row.snr_db = c.snr_db, row.seeds = seeds;
  Cell cell;
  std::vector<double> seconds, modulus_s, noise_m;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    const Phantom p = phantoms.make(c, 1000 + seed);
    const service::ProbeForce force{p.force_n, p.contact_area_m2};
    service::Estimate e;
    seconds.push_back(seconds_of([&] {
      e = elastography.estimate(p.pre, p.post, {p.geometry, force, p.tissue, {}, {}});
    }));
    modulus_s.push_back(e.modulus_s);
    noise_m.push_back(median_of(e.axial_displacement_std));
    const double background = std::log(client::Tissue{}.youngs_modulus_pa);
    const auto radii = [&](std::size_t n) { return p.radii(e.grid.x_m(n), e.grid.y_m(n)); };
    cell.add({e.grid, e.modulus.youngs_modulus, e.modulus.log_deviation, e.modulus.correlation_m,
              [&](std::size_t n) { return background + (radii(n) < 1 ? std::log(c.contrast) : 0); },
              [&](std::size_t n) { return (radii(n) - 1) * c.diameter_m / 2; }});
    show_progress(fmt::format("from RF: seed {} of {}", seed, seeds));
  }
  row.estimate_s = median_of(seconds), row.modulus_s = median_of(modulus_s), row.noise_m = median_of(noise_m);
  cell.complete(row);
  print(row);
  return row;
}

void promise(const std::vector<Row>& rows, Promises& promises) {
  double least = std::numeric_limits<double>::infinity(), most = 0, background = 0;
  double inside = 1, rim = 1, outside = 1;
  for (const Row& r : rows) {
    if (r.from == "prior") {
      least = std::min(least, r.standardised), most = std::max(most, r.standardised);
      continue;
    }
    inside = std::min(inside, r.inside), rim = std::min(rim, r.rim), outside = std::min(outside, r.outside);
    background = std::max(background, r.background_deviation);
  }
  promises.push_back({"drawn_from_the_prior_standardised_errors_least", least, 0.8, "", false});
  promises.push_back({"drawn_from_the_prior_standardised_errors_most", most, 1.25});
  promises.push_back({"lumps_least_share_within_95_percent_inside", inside, 0.9, "", false});
  promises.push_back({"lumps_least_share_within_95_percent_3_mm_from_edges", rim, 0.9, "", false});
  promises.push_back({"lumps_least_share_within_95_percent_outside", outside, 0.9, "", false});
  promises.push_back({"background_largest_median_stated_deviation_of_5_mm", background, 0.1});
}

PosteriorFigures measure(const SuiteOptions& options, Promises& promises) {
  const bool quick = options.quick;
  const auto device = service::Device::open();
  PosteriorFigures figures;
  using V = std::vector<double>;
  for (const double contrast : quick ? V{3} : V{1, 3, 10})
    for (const double diameter_m : quick || contrast == 1 ? V{10e-3} : V{8e-3, 15e-3})
      for (const double strain : quick ? V{0.01} : V{0.01, 0.03})
        for (const double noise_m : quick ? V{0.5e-6} : V{0.4e-6, 1.2e-6})
          figures.rows.push_back(
              drawn(device, {contrast, diameter_m, strain, noise_m, true}, quick ? 4 : 50));
  service::Elastography elastography(device);
  elastography.warm();
  Phantoms phantoms;
  for (const double contrast : quick ? V{3} : V{2, 3, 5, 10})
    for (const double diameter_m : quick ? V{10e-3} : V{8e-3, 15e-3})
      for (const double strain : quick ? V{0.01} : V{0.01, 0.03})
        for (const double snr_db : quick ? V{30} : V{20, 30}) {
          PhantomCase c{.strain = strain, .snr_db = snr_db, .contrast = contrast, .diameter_m = diameter_m};
          c.tissue_width_m = 0.160;
          figures.rows.push_back(from_rf(elastography, phantoms, c, quick ? 1 : 4));
        }
  promise(figures.rows, promises);
  return figures;
}

}  // namespace

void add_posterior_suite(CLI::App& app, bool& met) {
  add_suite(app, "posterior", "whether the deviations that come with a modulus are what it is off by",
            std::make_shared<SuiteOptions>(), met, measure,
            [](const PosteriorFigures&, const std::filesystem::path&) {});
}

}  // namespace teletact::bench
