#include "service/scene/told_slices.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "service/scene/slices.h"

namespace teletact::service {

void ToldSlices::tell(double z_m, std::vector<ToldTissue> tissues, const std::string& words) {
  if (tissues.empty()) return;
  std::size_t bytes = tissues.size() * sizeof(ToldTissue);
  for (const ToldTissue& t : tissues)
    bytes += sizeof(double) * static_cast<std::size_t>(t.information.size() + t.load.size());
  Told told{std::move(tissues), {}};
  try {
    told.held = account_.charge(Place::kHost, "told", bytes);
  } catch (const MemoryRefused& refused) {
    spdlog::warn("event=slice_not_heeded z_m={:.4f} error=\"{}\"", z_m, refused.what());
    return;
  }
  const std::lock_guard lock(mutex_);
  std::erase_if(told_, [&](const auto& slice) { return std::abs(slice.first - z_m) <= kSameSliceM; });
  told_[z_m] = std::move(told);
  words_ = words;
  if (told_.size() <= kMost) return;
  const auto first = told_.begin(), last = std::prev(told_.end());
  told_.erase(z_m - first->first > last->first - z_m ? first : last);
}

std::vector<ToldBeside> ToldSlices::beside(const ExplicitModulus& e, double z_m) const {
  const auto same = [](double a, double b) { return std::abs(a - b) <= kSameSliceM; };
  const auto published = [&](double at_m) {
    return std::ranges::any_of(e.slices_m, [&](double slice_m) { return same(slice_m, at_m); });
  };
  std::vector<ToldBeside> out;
  const std::lock_guard lock(mutex_);
  for (const auto& [at_m, told] : told_)
    if (!same(at_m, z_m) && published(at_m)) out.push_back({at_m - z_m, told.tissues});
  return out;
}

ToldRecord ToldSlices::all() const {
  ToldRecord out;
  const std::lock_guard lock(mutex_);
  for (const auto& [at_m, told] : told_) out.slices[at_m] = told.tissues;
  out.words = words_;
  return out;
}

std::string ToldSlices::words() const {
  const std::lock_guard lock(mutex_);
  return words_;
}

}  // namespace teletact::service
