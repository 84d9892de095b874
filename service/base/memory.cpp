#include "service/base/memory.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "service/base/limits.h"

namespace teletact::service {

struct Charge::Holder {
  Place place;
  std::array<std::string, 4> key;  // place, kind, client, scene
  std::uint64_t bytes = 0, charges = 0;
  const std::string& client() const { return key[2]; }
};

std::string name_of(Place place) {
  if (place == Place::kHost) return "host";
  const std::size_t number = static_cast<std::size_t>(place) - static_cast<std::size_t>(Place::kDevice);
  return number == 0 ? "device" : fmt::format("device {}", number);
}

std::uint64_t use_stamp() {
  static std::atomic<std::uint64_t> uses{0};
  return ++uses;
}

Charge::~Charge() {
  if (!budget_) return;
  bytes_ = std::exchange(bytes_, 0);
  budget_->give(holder_, bytes_);
}

void Charge::shrink(std::uint64_t bytes) {
  if (!budget_ || bytes >= bytes_) return;
  const std::lock_guard lock(budget_->mutex_);
  MemoryBudget::Side& side = budget_->sides_.at(static_cast<std::size_t>(holder_->place));
  const std::uint64_t less = bytes_ - bytes;
  side.held -= less, side.by_client[holder_->client()] -= less, holder_->bytes -= less;
  bytes_ = bytes;
}

Charge MemoryAccount::charge(Place place, const char* kind, std::uint64_t bytes) const {
  return budget && bytes > 0 ? budget->charge(place, kind, *this, bytes) : Charge();
}

void MemoryAccount::make_room(Place place, const char* kind, std::uint64_t bytes) const {
  if (budget) budget->make_room(place, kind, *this, bytes);
}

void MemoryAccount::add(Place place, std::weak_ptr<Reclaimable> reclaimable) const {
  if (budget) budget->add(place, *this, std::move(reclaimable));
}

MemoryBudget::MemoryBudget(const Limits& limits, std::size_t devices) : sides_(1 + devices) {
  const auto set = [&](Place place, std::uint64_t bytes) {
    Side& side = sides_.at(static_cast<std::size_t>(place));
    side.budget = bytes;
    side.client_budget = static_cast<std::uint64_t>(limits.client_memory_share * static_cast<double>(bytes));
  };
  set(Place::kHost, limits.host_memory_bytes);
  for (std::size_t k = 0; k < devices; ++k) set(place_of_device(k), limits.device_memory_bytes);
}

MemoryBudget::~MemoryBudget() = default;

// Why bytes do not fit; empty when they do.
struct MemoryBudget::Lack {
  std::string why;
  bool of_client = false;  // of its share alone: what others give back does not help
};

MemoryBudget::Lack MemoryBudget::lack(const Side& side, Place place, const char* kind,
                                      const MemoryAccount& account, std::uint64_t bytes) const {
  if (bytes > side.budget || side.held > side.budget - bytes)
    return {
        fmt::format("memory of the {}: {} bytes for {} do not fit, {} of {} are held; delete scenes, end "
                    "streams or ask for less",
                    name_of(place), bytes, kind, side.held, side.budget)};
  if (account.client.empty()) return {};
  const auto found = side.by_client.find(account.client);
  const std::uint64_t held = found == side.by_client.end() ? 0 : found->second;
  if (bytes > side.client_budget || held > side.client_budget - bytes)
    return {
        fmt::format("memory of the {}: {} bytes for {} do not fit, this client holds {} of the {} that one "
                    "may; delete scenes, end streams or ask for less",
                    name_of(place), bytes, kind, held, side.client_budget),
        true};
  return {};
}

// One thing given back. Called without the lock: what is given back returns its charges.
bool MemoryBudget::reclaim(Place place, const std::string* client) {
  std::vector<std::pair<std::uint64_t, std::shared_ptr<Reclaimable>>> oldest;
  {
    const std::lock_guard lock(mutex_);
    auto& all = sides_.at(static_cast<std::size_t>(place)).reclaimable;
    for (const auto& [of, weak] : all)
      if (!client || of == *client)
        if (auto reclaimable = weak.lock()) oldest.emplace_back(0, std::move(reclaimable));
  }
  for (auto& [use, reclaimable] : oldest) use = reclaimable->last_use();
  std::sort(oldest.begin(), oldest.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return std::any_of(oldest.begin(), oldest.end(), [](const auto& one) { return one.second->give_back(); });
}

void MemoryBudget::fit(std::unique_lock<std::mutex>& lock, Place place, const char* kind,
                       const MemoryAccount& account, std::uint64_t bytes) {
  const Side& side = sides_.at(static_cast<std::size_t>(place));
  // More than there can ever be is refused at once, and others keep what they have.
  const bool possible = bytes <= (account.client.empty() ? side.budget : side.client_budget);
  for (;;) {
    const auto [why, of_client] = lack(side, place, kind, account, bytes);
    if (why.empty()) return;
    lock.unlock();
    if (!possible || !reclaim(place, of_client ? &account.client : nullptr)) {
      // Whoever asks a thousand times a second is told so each time; the log is not.
      refusals_.tell(PacedLog::Clock::now(), [&] {
        return fmt::format("place={} kind={} client=\"{}\" scene={} why=\"{}\"", name_of(place), kind,
                           account.client, account.scene, why);
      });
      throw MemoryRefused(why);
    }
    lock.lock();
  }
}

void MemoryBudget::make_room(Place place, const char* kind, const MemoryAccount& account,
                             std::uint64_t bytes) {
  std::unique_lock lock(mutex_);
  fit(lock, place, kind, account, bytes);
}

Charge MemoryBudget::charge(Place place, const char* kind, const MemoryAccount& account,
                            std::uint64_t bytes) {
  Charge charge;
  std::unique_lock lock(mutex_);
  fit(lock, place, kind, account, bytes);
  std::array<std::string, 4> key{name_of(place), kind, account.client, account.scene};
  auto& holder = holders_[key];
  if (!holder) holder = std::make_unique<Charge::Holder>(Charge::Holder{place, std::move(key)});
  Side& side = sides_.at(static_cast<std::size_t>(place));
  side.by_client[account.client] += bytes;
  side.held += bytes, holder->bytes += bytes, ++holder->charges;
  charge.budget_ = shared_from_this();
  charge.holder_ = holder.get();
  charge.bytes_ = bytes;
  return charge;
}

void MemoryBudget::give(Charge::Holder* holder, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  Side& side = sides_.at(static_cast<std::size_t>(holder->place));
  side.held -= bytes, holder->bytes -= bytes;
  const auto client = side.by_client.find(holder->client());
  client->second -= bytes;
  if (--holder->charges > 0) return;
  if (client->second == 0) side.by_client.erase(client);
  holders_.erase(std::array<std::string, 4>(holder->key));
}

void MemoryBudget::add(Place place, const MemoryAccount& account, std::weak_ptr<Reclaimable> reclaimable) {
  const std::lock_guard lock(mutex_);
  Side& side = sides_.at(static_cast<std::size_t>(place));
  if (side.reclaimable.size() >= side.prune_at) {
    std::erase_if(side.reclaimable, [](const auto& one) { return one.second.expired(); });
    side.prune_at = 2 * side.reclaimable.size() + 64;
  }
  side.reclaimable.emplace_back(account.client, std::move(reclaimable));
}

std::uint64_t MemoryBudget::held(Place place) const {
  const std::lock_guard lock(mutex_);
  return sides_.at(static_cast<std::size_t>(place)).held;
}

std::uint64_t MemoryBudget::held(Place place, const std::string& client) const {
  const std::lock_guard lock(mutex_);
  const auto& clients = sides_.at(static_cast<std::size_t>(place)).by_client;
  const auto found = clients.find(client);
  return found == clients.end() ? 0 : found->second;
}

std::vector<MemoryUse> MemoryBudget::uses() const {
  const std::lock_guard lock(mutex_);
  std::vector<MemoryUse> uses;
  for (const auto& [key, holder] : holders_) {
    if (uses.empty() || uses.back().place != holder->place || uses.back().kind != key[1])
      uses.push_back({holder->place, key[1], 0});
    uses.back().bytes += holder->bytes;
  }
  return uses;
}

}  // namespace teletact::service
