#include "service/contact/contact_laws.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "service/base/choices.h"
#include "service/contact/area_sampler.h"
#include "service/contact/law_sampler.h"

namespace teletact::service {

namespace {

constexpr std::chrono::seconds kRetry{1};

std::unique_ptr<LawSampling> sampler_of(const Fingertip& tip, const Layer& layer,
                                        const std::shared_ptr<TouchedLayer>& touched, const Region& region,
                                        const Vector3& near_m) {
  if (region.z) return std::make_unique<AreaSampler>(touched, layer, tip, region, near_m);
  return std::make_unique<LawSampler>(touched, layer, tip, region.begin_x_m, region.end_x_m, near_m[0]);
}

}  // namespace

ContactLaws::ContactLaws(MemoryAccount account) : account_(std::move(account)) {}
ContactLaws::~ContactLaws() = default;

bool ContactLaws::has(const Layer& layer, const TouchWay& way, const Region& region) {
  return layer.normal == Layer{}.normal && (region.z || way.path != SolvePath::kGradients);
}

std::shared_ptr<const ContactLaw> ContactLaws::get(const Fingertip& tip, const Layer& layer,
                                                   const TouchWay& way,
                                                   const std::shared_ptr<TouchedLayer>& touched,
                                                   const Region& region, const Vector3& near_m,
                                                   const TouchWork& work) {
  auto entry = std::make_shared<Entry>();
  {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const auto& e) {
      return e->tip == tip && e->layer == layer && e->path == way.path && e->tolerance == way.tolerance;
    });
    const bool failed = found != entries_.end() && (*found)->retry;
    if (failed && *(*found)->retry < TouchedLayer::Clock::now()) {
      entries_.erase(found);
    } else if (found != entries_.end()) {
      (*found)->asked = ++asked_;
      return (*found)->law;
    }
    if (!has(layer, way, region)) return nullptr;
    if (entries_.size() == kMax)
      entries_.erase(
          std::min_element(entries_.begin(), entries_.end(),
                           [](const auto& one, const auto& other) { return one->asked < other->asked; }));
    entry->tip = tip, entry->layer = layer;
    entry->path = way.path, entry->tolerance = way.tolerance;
    entry->make = [=] { return sampler_of(tip, layer, touched, region, near_m); };
    entry->asked = ++asked_;
    entries_.push_back(entry);
  }
  if (work) {
    post(entry, work, way.client);
    return nullptr;
  }
  step(*entry, TouchedLayer::Clock::time_point::max());
  const std::lock_guard lock(mutex_);
  return entry->law;
}

// In steps, so that others have their turns, for as long as the model is there and its tip is asked for.
void ContactLaws::post(const std::shared_ptr<Entry>& entry, const TouchWork& work,
                       const std::string& client) {
  work(client, [weak = weak_from_this(), asked_for = std::weak_ptr(entry), work, client] {
    const auto self = weak.lock();
    const auto entry = asked_for.lock();
    if (!self || !entry) return;
    if (!self->step(*entry, TouchedLayer::Clock::now() + choices::kLawStep)) self->post(entry, work, client);
  });
}

// Whoever asks has what is near the finger long before the rest.
bool ContactLaws::step(Entry& entry, TouchedLayer::Clock::time_point until) {
  for (bool done = false; !done;) {
    const auto now = TouchedLayer::Clock::now();
    if (now >= until) return false;
    try {
      if (const auto make = std::exchange(entry.make, nullptr)) entry.sampler = make();
      done = entry.sampler->advance(now + choices::kLawShown);
    } catch (const std::exception& error) {
      spdlog::warn("event=law_not_sampled error=\"{}\"", error.what());
      const std::lock_guard lock(mutex_);
      entry.retry = now + kRetry;
      break;
    }
    if (!publish(entry, done)) break;
  }
  entry.sampler.reset();
  return true;
}

bool ContactLaws::publish(Entry& entry, bool whole) try {
  std::vector<LawColumn> columns = entry.sampler->columns();
  if (columns.size() < 2) return true;
  Charge charge = account_.charge(Place::kHost, "contact laws", columns.size() * sizeof(LawColumn));
  auto law = std::make_shared<const ContactLaw>(ContactLaw{std::move(columns), whole});
  const std::lock_guard lock(mutex_);
  entry.law = std::move(law);
  entry.charge = std::move(charge);
  return true;
} catch (const MemoryRefused&) {  // forces are solved for, as without a law
  return false;
}

}  // namespace teletact::service
