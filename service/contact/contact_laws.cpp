#include "service/contact/contact_laws.h"

#include <algorithm>
#include <utility>

#include "service/contact/law_sampler.h"
#include "service/plan/choices.h"

namespace teletact::service {

std::shared_ptr<const ContactLaw> ContactLaws::get(const Fingertip& tip, const Layer& layer,
                                                   const std::shared_ptr<TouchedLayer>& touched,
                                                   double begin_m, double end_m, const TouchWork& work,
                                                   const std::string& client) {
  if (layer.normal != Layer{}.normal || touched->path() != SolvePath::kCompliance) return nullptr;
  std::size_t entry = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(entries_.begin(), entries_.end(),
                                    [&](const Entry& e) { return e.tip == tip && e.layer == layer; });
    if (found != entries_.end()) return found->law;
    if (entries_.size() == kMost) return nullptr;
    entry = entries_.size();
    entries_.push_back({tip, layer, nullptr, {}});
  }
  const auto job = [self = weak_from_this(), entry, touched, begin_m, end_m] {
    if (const auto laws = self.lock()) laws->sample(entry, touched, begin_m, end_m);
  };
  if (work) {
    work(client, job);
    return nullptr;
  }
  job();
  const std::lock_guard lock(mutex_);
  return entries_[entry].law;
}

void ContactLaws::sample(std::size_t entry, const std::shared_ptr<TouchedLayer>& touched, double begin_m,
                         double end_m) try {
  Fingertip tip;
  Layer layer;
  {
    const std::lock_guard lock(mutex_);
    tip = entries_[entry].tip, layer = entries_[entry].layer;
  }
  LawSampler sampler(touched, layer, tip, begin_m, end_m);
  sampler.advance((begin_m + end_m) / 2, TouchedLayer::Clock::time_point::max());
  if (sampler.columns().size() < 2) return;
  Charge charge = account_.charge(Place::kHost, "contact laws", sampler.columns().size() * sizeof(LawColumn));
  ContactLaw law{sampler.columns(), choices::kLawBetween * sampler.report().worst_error,
                 sampler.report().solves};
  for (LawColumn& column : law.columns) {
    column.error_share = float(choices::kLawShare * law.tolerances);
    column.error_n = float(choices::kLawFloor * law.tolerances);
  }
  const std::lock_guard lock(mutex_);
  entries_[entry].law = std::make_shared<const ContactLaw>(std::move(law));
  entries_[entry].charge = std::move(charge);
} catch (const MemoryRefused&) {  // forces are solved for, as without a law
}

}  // namespace teletact::service
