#include "service/imaging/modulus/told_tissue.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "service/base/squared.h"
#include "service/imaging/modulus/skin.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// What the model leaves out alike of all slices is not below what so many leave of it.
constexpr double kMostSlices = 4;
constexpr double kNotWeighed = -5;  // ln of the likelihood of a tissue that a slice did not weigh; the least
// From slice to slice, of ln of elevation and depth: standard deviations; of the skin kSkinVariesLog.
constexpr double kElevationVaries = 0.02, kDepthVaries = 0.03;
constexpr double kUnlike = 3;        // deviations
constexpr double kLeastTold = 1e-6;  // of a variance, taken off: less is rounding

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
  const bool stated = place > 0 && m.place_m == w.beside_m;
  return {ends, slides, stated ? -1 : static_cast<int>(std::lround(100 * place))};
}

bool same(const ToldTissue& a, const ToldTissue& b) {
  return a.ends == b.ends && a.slides == b.slides && a.place == b.place;
}

const ToldTissue* find(const std::vector<ToldTissue>& tissues, const ToldTissue& name) {
  const auto at = std::ranges::find_if(tissues, [&](const ToldTissue& t) { return same(t, name); });
  return at == tissues.end() ? nullptr : &*at;
}

// What is told of a tissue: which columns of its fit, the face's before the skin's; what those are beyond;
// what is known of them beforehand, as the fit heeds it; how they vary from slice to slice.
struct Numbers {
  std::vector<Index> columns;
  VectorXd beyond, usual, known, varies;
};

constexpr std::size_t kLengths = 2;  // of them: the first, which are linear over kLinear

Numbers numbers_of(const TissueWindow& w, const CandidateTissue& m) {
  if (m.block || w.as_stated) return {};
  const RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
  const auto count = static_cast<Index>(kLengths + (m.with_skin ? kSkinChanges : 0));
  Numbers out{{}, VectorXd(count), VectorXd(count), VectorXd(count), VectorXd(count)};
  const auto add = [&](Index column, double beyond, double usual, double deviation, bool doubted,
                       double varies) {
    const auto n = std::ssize(out.columns);
    const double away = doubted ? (fit.at[column] + beyond - usual) / deviation : 0;
    out.columns.push_back(column);
    out.beyond[n] = beyond, out.usual[n] = usual, out.varies[n] = squared(varies);
    out.known[n] = 1 / squared(deviation) / (1 + squared(away) / 2);  // fit_robustly()
  };
  const auto length = [&](Index column, double at_m, const KnownLength& known, double varies) {
    add(column, std::log(at_m), known.log, known.deviation, known.stated, varies);
  };
  length(kElevation, m.face.elevation_m, w.elevation, kElevationVaries);
  length(kDepth, m.face.depth_m, w.depth, kDepthVaries);
  if (m.with_skin)
    for (std::size_t k = 0; k < kSkinChanges; ++k)
      add(fit.at.size() - static_cast<Index>(kSkinChanges - k), 0, w.skin.mean[k], w.skin.deviation[k], true,
          kSkinVariesLog);
  return out;
}

// Without what is known beforehand, which is alike in all slices.
void tell_numbers(const Numbers& of, const RobustFit& fit, ToldTissue& told) {
  if (of.columns.empty()) return;
  const MatrixXd all = fit.covariance(of.columns, of.columns).inverse();
  const Eigen::SelfAdjointEigenSolver<MatrixXd> own(all - MatrixXd(of.known.asDiagonal()));
  const VectorXd load = all * (fit.at(of.columns) + of.beyond) - of.known.cwiseProduct(of.usual);
  // Rounding apart, no combination of them has less than no information.
  const VectorXd sizes = own.eigenvalues().cwiseMax(0);
  const VectorXd some = (sizes.array() > 0).cast<double>();
  const MatrixXd& by = own.eigenvectors();
  told.information = by * sizes.asDiagonal() * by.transpose();
  told.load = by * some.asDiagonal() * by.transpose() * load;
}

// As other slices tell it, each varying from this one; no information: none does.
ToldTissue pooled(const std::vector<WeighedSlice>& slices, const ToldTissue& name, const VectorXd& varies) {
  const Index count = varies.size();
  ToldTissue out;
  for (const auto& [slice, weight] : slices) {
    const ToldTissue* told = find(slice.tissues, name);
    if (told == nullptr || told->load.size() != count || count == 0) continue;
    if (out.load.size() == 0)
      out.information = MatrixXd::Zero(count, count), out.load = VectorXd::Zero(count);
    const MatrixXd part =
        weight * (MatrixXd::Identity(count, count) + told->information * varies.asDiagonal()).inverse();
    out.information += part * told->information, out.load += part * told->load;
  }
  return out;
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
      tell_numbers(numbers_of(start.window, m), m.with_skin ? *m.with_skin : m.fit, told);
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
  // Where the face is tilted nothing that ends is tried, and nothing is told of where the tissue does.
  const auto weighed_ends = [](const WeighedSlice& w) {
    return std::ranges::any_of(w.slice.tissues,
                               [](const ToldTissue& t) { return t.ends == 1 || t.ends == 2; });
  };
  for (WeighedTissues& start : starts) {
    const std::vector<WeighedSlice> slices = weighed(beside, start.window.face.elevation_m);
    for (CandidateTissue& m : start.models)
      for (const WeighedSlice& w : slices) {
        if (!weighed_ends(w)) continue;
        const ToldTissue* told = find(w.slice.tissues, named(start.window, m));
        m.log_prior += w.weight * (told ? std::max(kNotWeighed, told->log_likelihood) : kNotWeighed);
      }
  }
}

Heeded sharpen(const std::vector<ToldBeside>& beside, std::vector<WeighedTissues>& starts) {
  Heeded out = Heeded::kNothing;
  double heaviest = 0;
  for (WeighedTissues& start : starts) {
    const std::vector<WeighedSlice> slices = weighed(beside, start.window.face.elevation_m);
    for (CandidateTissue& m : start.models) {
      const Numbers of = numbers_of(start.window, m);
      const ToldTissue told = pooled(slices, named(start.window, m), of.varies);
      Heeded here = Heeded::kNothing;
      if (told.load.size() > 0) {
        // As one more measurement of those columns together.
        RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
        const MatrixXd across = fit.covariance(Eigen::all, of.columns),
                       own = fit.covariance(of.columns, of.columns);
        const Index count = own.rows();
        const MatrixXd gain = across * (MatrixXd::Identity(count, count) + told.information * own).inverse();
        const VectorXd moved = gain * (told.load - told.information * (fit.at(of.columns) + of.beyond));
        const MatrixXd less = gain * told.information * across.transpose();
        here = Heeded::kAll;
        for (std::size_t n = 0; n < of.columns.size(); ++n) {
          const Index c = of.columns[n];
          if (!(less(c, c) > kLeastTold * fit.covariance(c, c))) continue;
          if (std::abs(moved[c]) > kUnlike * std::sqrt(less(c, c)) ||
              (n < kLengths && std::abs(moved[c]) > kLinear))
            here = Heeded::kContradicted;
        }
        if (here == Heeded::kAll) fit.at += moved, fit.covariance -= (less + less.transpose()) / 2;
      }
      if (m.weight > heaviest) heaviest = m.weight, out = here;
    }
  }
  return out;
}

void weigh_together(std::vector<WeighedTissues>& starts) {
  using Models = std::vector<CandidateTissue*>;  // of one kind and start, the likeliest first
  std::vector<Models> counted;
  for (WeighedTissues& start : starts) {
    std::map<std::array<int, 2>, Models> kinds;
    for (CandidateTissue& m : start.models) kinds[kind_of(m)].push_back(&m);
    for (auto& [kind, models] : kinds) {
      std::ranges::sort(models, std::ranges::greater{}, &CandidateTissue::odds);
      const auto twin = std::ranges::find_if(counted, [&](const Models& others) {
        return kind_of(*others[0]) == kind &&
               (models[0]->block || apart(*others[0], *models[0]) < kOtherLength);
      });
      if (twin == counted.end())
        counted.push_back(models);
      else if (models[0]->odds() > (*twin)[0]->odds())
        *twin = models;
    }
  }
  double best = -HUGE_VAL, sum = 0;
  for (const Models& models : counted) best = std::max(best, models[0]->odds());
  for (const Models& models : counted)
    for (CandidateTissue* m : models) sum += m->weight = std::exp(m->odds() - best);
  for (const Models& models : counted)
    for (CandidateTissue* m : models) m->weight /= sum;
}

TogetherWeighed weigh_together(const TissueWeigher& weigher, const std::vector<ToldBeside>& beside,
                               std::vector<WeighedTissues>& starts) {
  const auto weigh = [&](std::vector<WeighedTissues>& of) {
    weigh_together(of);
    for (WeighedTissues& start : of)
      for (CandidateTissue& m : start.models)
        if (m.weight > kLeastWeight && !m.with_skin)
          weigher.fit_skin(start.window, m, std::hypot(m.fit.rest, kModelLog));
  };
  weigh(starts);
  TogetherWeighed out{told_by(starts)};
  if (beside.empty()) return out;
  std::vector<WeighedTissues> together = starts;
  add_odds(beside, together);
  weigh(together);
  out.heeded = sharpen(beside, together);
  if (out.heeded != Heeded::kContradicted) starts = std::move(together);
  return out;
}

}  // namespace teletact::service
