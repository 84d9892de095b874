#include "service/imaging/modulus/told_tissue.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "service/base/squared.h"
#include "service/imaging/modulus/skin.h"

namespace teletact::service {
namespace {

using Eigen::Index;

// What the model leaves out alike of all slices is not below what so many leave of it.
constexpr double kMostSlices = 4;
constexpr double kNotWeighed = -5;  // ln of the likelihood of a tissue that a slice did not weigh; the least
// From slice to slice, of ln of elevation and depth: standard deviations; of the skin kSkinVariesLog.
constexpr double kElevationVaries = 0.02, kDepthVaries = 0.03;
constexpr double kUnlike = 3;            // deviations
constexpr double kLeastInformed = 0.05;  // of what is known beforehand: less tells nothing

struct WeighedSlice {
  const ToldBeside& slice;
  double weight;
};

// A face sees the tissue around its image, too: slices nearer to each other than it is long count in part.
std::vector<WeighedSlice> weighed(const std::vector<ToldBeside>& beside, double elevation_m) {
  std::vector<WeighedSlice> out;
  double sum = 0;
  for (const ToldBeside& slice : beside) {
    double gap_m = std::abs(slice.offset_m);  // to the next on the way to this image
    for (const ToldBeside& other : beside)
      if (other.offset_m * slice.offset_m > 0 && std::abs(other.offset_m) < std::abs(slice.offset_m))
        gap_m = std::min(gap_m, std::abs(slice.offset_m - other.offset_m));
    out.push_back({slice, std::min(1.0, gap_m / elevation_m)});
    sum += out.back().weight;
  }
  if (sum > kMostSlices)
    for (WeighedSlice& w : out) w.weight *= kMostSlices / sum;
  return out;
}

ToldTissue named(const TissueWindow& w, const CandidateTissue& m) {
  const auto [ends, slides] = kind_of(m);
  const double place = m.face.goes_on() ? 0 : m.place_m / w.face.depth_m;
  return {ends, slides, static_cast<int>(std::lround(100 * place)), 0, {}};
}

bool same(const ToldTissue& a, const ToldTissue& b) {
  return a.ends == b.ends && a.slides == b.slides && a.place == b.place;
}

const ToldTissue* find(const std::vector<ToldTissue>& tissues, const ToldTissue& name) {
  const auto at = std::ranges::find_if(tissues, [&](const ToldTissue& t) { return same(t, name); });
  return at == tissues.end() ? nullptr : &*at;
}

// Of what is told of a tissue: which column of its fit it is, what that is beyond, and what is known of it
// beforehand.
struct NumberOfFit {
  Index column;
  double beyond, usual, known_variance, varies;
};

constexpr std::size_t kLengths = 2;  // of them: the first, which are linear over kLinear

std::vector<NumberOfFit> numbers_of(const TissueWindow& w, const CandidateTissue& m) {
  if (m.block || w.as_stated) return {};
  std::vector<NumberOfFit> out;
  const auto length = [&](Index column, double at_m, const KnownLength& known, double varies) {
    out.push_back({column, std::log(at_m), known.log, squared(known.deviation), squared(varies)});
  };
  length(kElevation, m.face.elevation_m, w.elevation, kElevationVaries);
  length(kDepth, m.face.depth_m, w.depth, kDepthVaries);
  if (m.with_skin)
    for (std::size_t k = 0; k < kSkinChanges; ++k)
      out.push_back({m.with_skin->at.size() - static_cast<Index>(kSkinChanges - k), 0, w.skin.mean[k],
                     squared(w.skin.deviation[k]), squared(kSkinVariesLog)});
  return out;
}

// Of number n, as other slices tell it: mean and variance.
std::optional<ToldTissue::Number> pooled(const std::vector<WeighedSlice>& slices, const ToldTissue& name,
                                         std::size_t n, double varies) {
  double information = 0, sum = 0;
  for (const auto& [slice, weight] : slices) {
    const ToldTissue* told = find(slice.tissues, name);
    if (told == nullptr || n >= told->numbers.size()) continue;
    const double share = weight / (told->numbers[n].variance + varies);
    information += share, sum += share * told->numbers[n].mean;
  }
  if (!(information > 0)) return {};
  return ToldTissue::Number{sum / information, 1 / information};
}

}  // namespace

std::vector<ToldTissue> told_by(const std::vector<WeighedTissues>& starts) {
  std::vector<ToldTissue> out;
  double best = -HUGE_VAL;
  for (const WeighedTissues& start : starts)
    for (const CandidateTissue& m : start.models) {
      ToldTissue told = named(start.window, m);
      told.log_likelihood = -m.fit.misfit;
      best = std::max(best, told.log_likelihood);
      const RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
      for (const NumberOfFit& of : numbers_of(start.window, m)) {
        ToldTissue::Number& number = told.numbers.emplace_back();
        const double variance = fit.covariance(of.column, of.column),
                     information = 1 / variance - 1 / of.known_variance;
        if (information * of.known_variance < kLeastInformed) continue;
        number.mean =
            ((fit.at[of.column] + of.beyond) / variance - of.usual / of.known_variance) / information;
        number.variance = 1 / information;
      }
      const auto twin = std::ranges::find_if(out, [&](const ToldTissue& t) { return same(t, told); });
      if (twin == out.end())
        out.push_back(std::move(told));
      else if (told.log_likelihood > twin->log_likelihood)
        *twin = std::move(told);
    }
  for (ToldTissue& told : out) told.log_likelihood -= best;
  return out;
}

void add_odds(const std::vector<ToldBeside>& beside, std::vector<WeighedTissues>& starts) {
  for (WeighedTissues& start : starts) {
    const std::vector<WeighedSlice> slices = weighed(beside, start.window.face.elevation_m);
    for (CandidateTissue& m : start.models)
      for (const auto& [slice, weight] : slices) {
        const ToldTissue* told = find(slice.tissues, named(start.window, m));
        m.log_prior += weight * (told ? std::max(kNotWeighed, told->log_likelihood) : kNotWeighed);
      }
  }
}

bool sharpen(const std::vector<ToldBeside>& beside, std::vector<WeighedTissues>& starts) {
  std::vector<WeighedTissues> out = starts;
  double heaviest = 0, away_of_heaviest = 0;
  for (WeighedTissues& start : out) {
    const std::vector<WeighedSlice> slices = weighed(beside, start.window.face.elevation_m);
    for (CandidateTissue& m : start.models) {
      RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
      const std::vector<NumberOfFit> numbers = numbers_of(start.window, m);
      double away = 0;
      for (std::size_t n = 0; n < numbers.size(); ++n) {
        const NumberOfFit& of = numbers[n];
        const auto told = pooled(slices, named(start.window, m), n, of.varies);
        if (!told) continue;
        // As one more measurement of that column.
        const double off = told->mean - of.beyond - fit.at[of.column],
                     variance = fit.covariance(of.column, of.column) + told->variance;
        away = std::max(away, std::abs(off) / std::sqrt(variance));
        const Eigen::VectorXd gain = fit.covariance.col(of.column) / variance;
        if (n < kLengths && std::abs(gain[of.column] * off) > kLinear) away = HUGE_VAL;
        fit.at += gain * off;
        fit.covariance -= (gain * fit.covariance.row(of.column)).eval();
      }
      if (m.weight > heaviest) heaviest = m.weight, away_of_heaviest = away;
    }
  }
  if (away_of_heaviest > kUnlike) return false;
  starts = std::move(out);
  return true;
}

}  // namespace teletact::service
