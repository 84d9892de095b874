// The paper's psychophysics (T6.4): the fits of its Tables 2 and 3 beside its own figures, and what its
// method is worth: simulated observers whose Weber fraction is known, with perfect stiffness and through the
// whole chain, from late answers to the device.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>

#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/stability/felt.h"
#include "bench/stability/servo_period.h"
#include "bench/suites/paper/paper.h"
#include "client/experiment/bootstrap.h"
#include "client/experiment/observer.h"
#include "client/patient/parallel.h"

namespace teletact::client {
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StimulusCount, stimulus_n_m, harder, not_harder)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Interval, low, high)
}  // namespace teletact::client

namespace teletact::bench {
namespace {

using namespace client;  // NOLINT: the experiment's words, throughout

constexpr double kBackgroundNM = 25;
constexpr double kDigit = 0.0005;  // half of the last digit that T6.4 states
constexpr double kCoverMin = 0.92, kCoverMax = 0.98, kBiasMax = 0.01, kChainAddsMax = 0.05;
constexpr std::array<double, 3> kWeberFractions{0.1, 0.2, 0.4};

struct PaperTable {
  const char *name, *title;
  std::vector<StimulusCount> counts;
  // alpha (N/m), beta, Weber fraction: reproduced independently (T6.4), and printed in the paper.
  std::array<double, 3> reproduced, printed;
};

std::vector<PaperTable> paper_tables() {
  return {{"perfect_stiffness",
           "perfect stiffness (the paper's Fig. 17)",
           {{27.5, 2, 8}, {30, 3, 6}, {32.5, 2, 3}, {35, 5, 2}, {37.5, 5, 0}},
           {32.571, 8.911, 0.408},
           {32.57, 8.91, 0.40}},
          {"kalman",
           "Kalman filter (the paper's Fig. 18)",
           {{27.5, 3, 2}, {30, 3, 2}, {32.5, 4, 1}, {35, 5, 0}, {37.5, 5, 0}},
           {27.033, 5.080, 0.239},
           {27.03, 5.08, 0.23}}};
}

struct TableFit {
  double alpha_n_m = 0, beta = 0, threshold_n_m = 0, weber_fraction = 0;
  bool at_limit = false;
  // 95 %, none at a limit.
  Interval alpha_interval_n_m{kNan, kNan}, beta_interval{kNan, kNan}, weber_fraction_interval{kNan, kNan};
  unsigned resamples = 0, resamples_at_limit = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TableFit, alpha_n_m, beta, threshold_n_m, weber_fraction, at_limit,
                                   alpha_interval_n_m, beta_interval, weber_fraction_interval, resamples,
                                   resamples_at_limit)
struct FittedTable {
  std::string name, title;
  std::vector<StimulusCount> answers;
  TableFit least_squares, maximum_likelihood, paper;  // paper: as printed
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(FittedTable, name, title, answers, least_squares, maximum_likelihood,
                                   paper)

TableFit fit_table(const std::vector<StimulusCount>& counts, FitMethod method, unsigned resamples) {
  const FitOptions how{method, 0};
  const Fit fit = fit_weibull(counts, how);
  TableFit out{fit.function.alpha_n_m, fit.function.beta, threshold_n_m(fit.function),
               weber_fraction(fit.function, kBackgroundNM), fit.at_limit};
  if (fit.at_limit) return out;
  const BootstrapResult spread = bootstrap(counts, fit, how, kBackgroundNM, {resamples, 0.95, 1});
  out.alpha_interval_n_m = spread.alpha_n_m;
  out.beta_interval = spread.beta;
  out.weber_fraction_interval = spread.weber_fraction;
  out.resamples = resamples;
  out.resamples_at_limit = spread.at_limit;
  return out;
}

FittedTable fit_paper(const PaperTable& table, unsigned resamples, Promises& promises) {
  FittedTable out{table.name,
                  table.title,
                  table.counts,
                  fit_table(table.counts, FitMethod::kLeastSquares, resamples),
                  fit_table(table.counts, FitMethod::kMaximumLikelihood, resamples),
                  {table.printed[0], table.printed[1], kNan, table.printed[2]}};
  const TableFit& squares = out.least_squares;
  const auto promise = [&](const char* what, double value, double expected, const char* unit) {
    promises.push_back({snake_case(fmt::format("{} {} off {:.3f}", table.name, what, expected)),
                        std::abs(value - expected), kDigit, unit});
  };
  promise("alpha", squares.alpha_n_m, table.reproduced[0], "N/m");
  promise("beta", squares.beta, table.reproduced[1], "");
  promise("Weber fraction", squares.weber_fraction, table.reproduced[2], "");
  std::printf("%-18s alpha %.3f beta %.3f Weber fraction %.3f (paper %.2f, %.2f, %.2f)\n", table.name,
              squares.alpha_n_m, squares.beta, squares.weber_fraction, table.printed[0], table.printed[1],
              table.printed[2]);
  return out;
}

struct Effort {
  unsigned experiments, resamples;
};

// What is felt of a stimulus (N/m): itself with perfect stiffness, else one of the passes through the chain.
using Feel = std::function<double(double stimulus_n_m, Random&)>;

double felt_perfectly(double stimulus_n_m, Random&) {
  return stimulus_n_m;
}

Feel felt_through(const FeltOptions& chain, const ExperimentPlan& plan) {
  constexpr unsigned kPasses = 40;
  std::map<double, std::vector<double>> felt;
  for (const double stimulus_n_m : plan.stimuli_n_m)
    felt[stimulus_n_m] = felt_stiffness(chain, plan.background_n_m, stimulus_n_m, kPasses);
  return [felt](double stimulus_n_m, Random& random) {
    const std::vector<double>& passes = felt.at(stimulus_n_m);
    return passes[static_cast<std::size_t>(random.uniform() * static_cast<double>(passes.size()))];
  };
}

// Judges what it feels.
Observer feeling_observer(const Weibull& function, const Feel& feel, std::uint64_t seed) {
  const auto random = std::make_shared<Random>(seed);
  return [=](const Trial& trial, std::size_t, std::size_t) -> std::optional<bool> {
    return random->happens(probability_harder(function, feel(trial.stimulus_n_m, *random)));
  };
}

// The same experiment by one observer, many times.
struct Observed {
  double weber_fraction = 0, lapse_rate = 0;
  std::string method;
  double lapse_rate_max = 0, coverage = 0, bias = 0, rms_error = 0;
  unsigned unbounded = 0;
  std::vector<std::array<double, 3>> estimate_low_high{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Observed, weber_fraction, lapse_rate, method, lapse_rate_max, coverage,
                                   bias, rms_error, unbounded, estimate_low_high)

Observed observe(const ObserverDescription& observer, const FitOptions& how, const Effort& effort,
                 const Feel& feel = felt_perfectly) {
  const Weibull truth = psychometric_function(observer, kBackgroundNM);
  Random random(1);
  const ExperimentPlan plan;
  Observed out{observer.weber_fraction, observer.lapse_rate, name_of(how.method), how.lapse_rate_max};
  unsigned covered = 0;
  double squares = 0;
  for (unsigned k = 0; k < effort.experiments; ++k) {
    const auto trials = random_order(plan, random);
    const auto counts = count_answers(run_experiment(trials, feeling_observer(truth, feel, random.seed())));
    const Fit fit = fit_weibull(counts, how);
    const double error = weber_fraction(fit.function, kBackgroundNM) - observer.weber_fraction;
    out.bias += error / effort.experiments;
    squares += error * error / effort.experiments;
    if (fit.at_limit) {  // without an interval: not covered
      ++out.unbounded;
      continue;
    }
    const Interval interval =
        bootstrap(counts, fit, how, kBackgroundNM, {effort.resamples, 0.95, random.seed()}).weber_fraction;
    covered += interval.contains(observer.weber_fraction);
    out.estimate_low_high.push_back({error + observer.weber_fraction, interval.low, interval.high});
  }
  out.coverage = static_cast<double>(covered) / effort.experiments;
  out.rms_error = std::sqrt(squares);
  return out;
}

void print(const Observed& o) {
  std::printf("Weber fraction %.2f, lapse rate %.2f, %s%s: coverage %.3f, bias %+.4f, rms error %.4f\n",
              o.weber_fraction, o.lapse_rate, o.method.c_str(), o.lapse_rate_max > 0 ? " with lapses" : "",
              o.coverage, o.bias, o.rms_error);
}

// Returns the observer's name, for further promises.
std::string promise(const Observed& o, Promises& promises, const std::string& how = "") {
  const std::string name =
      snake_case(fmt::format("observer of Weber fraction {:.2f} {}{}", o.weber_fraction, o.method, how));
  promises.push_back(
      {name + "_interval_covers_the_truth_least", o.coverage, kCoverMin, "of experiments", false});
  promises.push_back({name + "_interval_covers_the_truth_most", o.coverage, kCoverMax, "of experiments"});
  promises.push_back({name + "_bias_of_the_weber_fraction", std::abs(o.bias), kBiasMax});
  return name;
}

struct ObserverFigures {
  std::vector<double> stimuli_n_m;
  unsigned trials_per_stimulus = 0, experiments = 0, resamples = 0, lapsing_experiments = 0;
  std::vector<Observed> rows{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ObserverFigures, stimuli_n_m, trials_per_stimulus, experiments, resamples,
                                   lapsing_experiments, rows)

// Promised without lapses, by both methods; told beside it: what lapses of 3 % do to a fit that knows of them
// and to one that does not.
ObserverFigures observe_all(const Effort& effort, Promises& promises) {
  const ExperimentPlan plan;
  const Effort fewer{std::min(effort.experiments, 200u), std::min(effort.resamples, 99u)};
  ObserverFigures out{plan.stimuli_n_m, plan.trials_per_stimulus, effort.experiments, effort.resamples,
                      fewer.experiments};
  for (const double weber : kWeberFractions)
    for (const FitMethod method : {FitMethod::kMaximumLikelihood, FitMethod::kLeastSquares}) {
      out.rows.push_back(observe({weber, 0, 0}, {method, 0}, effort));
      promise(out.rows.back(), promises);
      print(out.rows.back());
    }
  for (const double most : {0.0, 0.1}) {
    out.rows.push_back(observe({0.2, 0.03, 0}, {FitMethod::kMaximumLikelihood, most}, fewer));
    print(out.rows.back());
  }
  return out;
}

struct ChainCase {
  FeltOptions chain;
  std::string name;
  bool promised = false;
};

// At 100 Hz, answers 5 ms late (one machine) and 20 ms late (a network), over how sharp an inclusion's edges
// are; beside them the exact force at every tick, since wide edges leave no plateau whose contrast were the
// stimulus. Promised are edges of 1 and 1.5 mm where answers are 5 ms late, of 1.5 and 2 mm where they are 20
// ms late: sharper ones are overshot, softer ones felt softer. Told, at 1.5 mm: force alone, and few and late
// answers.
std::vector<ChainCase> chain_cases() {
  std::vector<ChainCase> all;
  for (const double edge_m : {0.0005, 0.001, 0.0015, 0.002, 0.003}) {
    all.push_back({{.renderer = "hold", .update_s = kServoS, .model_delay_s = 0, .edge_m = edge_m},
                   "exact force at every tick"});
    for (const double late_s : {0.005, 0.02})
      all.push_back(
          {{.model_delay_s = late_s, .edge_m = edge_m},
           fmt::format("through the chain, {:.0f} ms late", 1e3 * late_s),
           late_s < 0.01 ? edge_m >= 0.001 && edge_m <= 0.0015 : edge_m >= 0.0015 && edge_m <= 0.002});
  }
  all.push_back({{.renderer = "kalman-force"}, "force alone, 5 ms late"});
  all.push_back({{.update_s = 0.05, .model_delay_s = 0.1}, "20 Hz, 100 ms late"});
  // By the contact law over a round trip of 200 ms, checked by 20 answers a second. With edges of 2 mm and
  // more the exact force, too, has no plateau.
  for (const double edge_m : {0.0005, 0.001, 0.0015, 0.002, 0.003})
    all.push_back({{.renderer = "law", .update_s = 0.05, .model_delay_s = 0.2, .edge_m = edge_m},
                   "by the contact law, 200 ms late",
                   edge_m < 0.002});
  return all;
}

struct ChainFigures {
  std::string how;
  bool promised = false;
  std::string renderer;
  double update_s = 0, model_delay_s = 0, edge_m = 0;
  Observed observed{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ChainFigures, how, promised, renderer, update_s, model_delay_s, edge_m,
                                   observed)

std::vector<ChainFigures> observe_chain(const Effort& effort, Promises& promises) {
  const Effort fewer{std::min(effort.experiments, 300u), std::min(effort.resamples, 99u)};
  const std::vector<ChainCase> cases = chain_cases();
  std::vector<ChainFigures> rows(cases.size() * kWeberFractions.size());
  client::in_parallel(rows.size(), [&](std::size_t n) {
    const ChainCase& one = cases[n / kWeberFractions.size()];
    const FeltOptions& chain = one.chain;
    const ObserverDescription observer{kWeberFractions[n % kWeberFractions.size()], 0, 0};
    rows[n] = {one.name,
               one.promised,
               chain.renderer,
               chain.update_s,
               chain.model_delay_s,
               chain.edge_m,
               observe(observer, {FitMethod::kMaximumLikelihood, 0}, one.promised ? effort : fewer,
                       felt_through(chain, ExperimentPlan()))};
  });
  for (const ChainFigures& row : rows) {
    const std::string how = fmt::format(" {}, edges of {} mm", row.how, 1e3 * row.edge_m);
    std::printf("%s: ", how.c_str());
    print(row.observed);
    if (!row.promised) continue;
    const std::string name = promise(row.observed, promises, how);
    promises.push_back({name + "_the_chain_adds", row.observed.bias, kChainAddsMax});
  }
  // Where edges are too soft for a plateau: no more than the exact force's own.
  constexpr double kSoftM = 0.002, kLawAddsMax = 0.003;
  const auto soft = [](const ChainFigures& row, const char* renderer) {
    return row.edge_m == kSoftM && row.renderer == renderer;
  };
  for (const ChainFigures& law : rows)
    for (const ChainFigures& exact : rows)
      if (soft(law, "law") && soft(exact, "hold") &&
          law.observed.weber_fraction == exact.observed.weber_fraction)
        promises.push_back(
            {snake_case(fmt::format("soft_edges_weber_{}_the_law_adds", law.observed.weber_fraction)),
             std::abs(law.observed.bias - exact.observed.bias), kLawAddsMax});
  return rows;
}

struct Figures {
  double background_n_m = kBackgroundNM;
  std::vector<FittedTable> fits{};
  ObserverFigures observers{};
  std::vector<ChainFigures> chain{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, background_n_m, fits, observers, chain)

Figures measure(bool quick, Promises& promises) {
  Figures figures;
  std::printf("\n");
  for (const PaperTable& table : paper_tables())
    figures.fits.push_back(fit_paper(table, quick ? 200 : 2000, promises));
  const Effort effort = quick ? Effort{200, 59} : Effort{1000, 199};
  figures.observers = observe_all(effort, promises);
  figures.chain = observe_chain(effort, promises);
  return figures;
}

// The paper's form: shares as stars, the fitted curve; the threshold as a cross hair.
void draw_fit(const FittedTable& one, const std::filesystem::path& file) {
  Curve answers{.title = "answers", .style = "points pt 3 ps 2 lc rgb 'black'"};
  for (const StimulusCount& a : one.answers) answers.add(a.stimulus_n_m, a.share_harder());
  const auto curve = [](const char* style, const TableFit& fit) {
    return fmt::format(", 1 - 2**(-(x / {})**{}) with lines {}", fit.alpha_n_m, fit.beta, style);
  };
  const TableFit& squares = one.least_squares;
  plot(file,
       script_of(
           {answers},
           fmt::format("set arrow from {0},0 to {0},0.75 nohead dt 3\n"
                       "set arrow from 25,0.75 to {0},0.75 nohead dt 3\n"
                       "set label 'Weber fraction {1:.3f} (paper {2:.2f})' at {0},0.70 offset 1,0\n"
                       "set xrange [25:45]\nset yrange [0:1.05]\nset key bottom right\n",
                       squares.threshold_n_m, squares.weber_fraction, one.paper.weber_fraction) +
               axes("Psychometric function, " + one.title, "stimulus (N/m)", "probability of \"harder\""),
           curve("lw 5 lc rgb '#bbbbbb' title 'the paper''s curve'", one.paper) +
               curve("lw 2 lc 1 title 'least squares (its method)'", squares) +
               curve("lw 2 dt 2 lc 2 title 'maximum likelihood'", one.maximum_likelihood)));
}

// Every experiment's interval, in the order of its estimate, about the truth.
void draw_observers(const ObserverFigures& observers, const std::filesystem::path& file) {
  std::string script =
      "set multiplot layout 1,3 title '95 % intervals of the Weber fraction, each by one simulated "
      "experiment "
      "(red: misses the truth)'\nset xrange [0:1]\nset xtics 0.5\nunset key\n";
  for (const Observed& o : observers.rows) {
    if (o.method != name_of(FitMethod::kMaximumLikelihood) || o.lapse_rate > 0) continue;
    auto estimates = o.estimate_low_high;
    std::sort(estimates.begin(), estimates.end());
    script += "$intervals << EOD\n";
    const double truth = o.weber_fraction;
    for (std::size_t k = 0; k < estimates.size(); ++k) {
      const auto [estimate, low, high] = estimates[k];
      script += fmt::format("{} {} {} {} {}\n", (k + 0.5) / static_cast<double>(estimates.size()), estimate,
                            low, high - low, low <= truth && truth <= high ? "0xb0c4de" : "0xd62728");
    }
    script += "EOD\n" +
              axes(fmt::format("{:.2f}: {:.1f} % cover, bias {:+.4f}", truth, 100 * o.coverage, o.bias),
                   "share of the experiments", "Weber fraction") +
              fmt::format(
                  "set yrange [0:{}]\nplot $intervals using 1:3:(0):4:5 with vectors nohead lc rgb "
                  "variable, $intervals using 1:2 with lines lw 2 lc rgb '#08306b', {} with lines lw 2 "
                  "lc rgb 'black'\n",
                  2.2 * truth, truth);
  }
  plot(file, script + "unset multiplot\n");
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  for (const FittedTable& one : figures.fits) draw_fit(one, folder / ("psychometric_" + one.name + ".png"));
  draw_observers(figures.observers, folder / "psychometric_observers.png");
}

}  // namespace

Part paper_psychometric() {
  return make_part("psychometric", measure, draw);
}

}  // namespace teletact::bench
