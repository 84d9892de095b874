// Who holds how many bytes. There is one budget for the host and one for each device. What may grow with what
// peers send is charged to the client and the scene that cause it before it is allocated, and returned when
// it is gone. What can be made again (Reclaimable) is given back in the order of last use when there is no
// room; what then still does not fit is refused with the sizes.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/base/paced_log.h"

namespace teletact::service {

struct Limits;

// The host, and each device that the service uses: kDevice is the first.
enum class Place : std::size_t { kHost, kDevice };
constexpr Place place_of_device(std::size_t number) {  // from 0
  return static_cast<Place>(static_cast<std::size_t>(Place::kDevice) + number);
}
std::string name_of(Place);  // "host", "device", "device 1" for the second ...

// There is no room. what(): one line with the sizes asked for, held and allowed, and a remedy.
struct MemoryRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class MemoryBudget;

// Bytes that are held, returned when it goes. An empty one holds none.
class Charge {
 public:
  Charge() = default;
  Charge(Charge&& other) noexcept { swap(other); }
  Charge& operator=(Charge&& other) noexcept {
    Charge(std::move(other)).swap(*this);
    return *this;
  }
  ~Charge();
  std::uint64_t bytes() const { return bytes_; }
  void shrink(std::uint64_t bytes);  // to so many, where it is more

 private:
  friend class MemoryBudget;
  void swap(Charge& other) noexcept {
    std::swap(budget_, other.budget_), std::swap(holder_, other.holder_), std::swap(bytes_, other.bytes_);
  }
  struct Holder;
  std::shared_ptr<MemoryBudget> budget_;
  Holder* holder_ = nullptr;
  std::uint64_t bytes_ = 0;
};

// Something that can be made again when it is missed. Thread-safe.
class Reclaimable {
 public:
  virtual ~Reclaimable() = default;
  // When what it would give back next was used last, as stamps of use_stamp() count.
  virtual std::uint64_t last_use() const = 0;
  // Gives back what was used least recently and nobody is using: false when there is no such thing. Must not
  // wait for anybody nor charge anything: whoever needs room calls it, from any thread, whatever it holds.
  virtual bool give_back() = 0;
};

// Counts up with every call.
std::uint64_t use_stamp();

struct MemoryUse {
  Place place;
  std::string kind;
  std::uint64_t bytes;
};

// In whose name memory is held. One without a budget charges nothing; one without a client is the service
// itself, which has no share of its own to keep to.
struct MemoryAccount {
  std::shared_ptr<MemoryBudget> budget = {};
  std::string client = {}, scene = {};

  // Makes room if it must. Throws MemoryRefused; nothing is held then. `kind`: what for, as GetInfo says it.
  Charge charge(Place, const char* kind, std::uint64_t bytes) const;
  // Makes room for what will be charged in parts, so that it is refused as a whole and beforehand.
  void make_room(Place, const char* kind, std::uint64_t bytes) const;
  void add(Place, std::weak_ptr<Reclaimable>) const;
};

class MemoryBudget : public std::enable_shared_from_this<MemoryBudget> {
 public:
  // `limits`: resolved(); each device has the same budget.
  explicit MemoryBudget(const Limits& limits, std::size_t devices = 1);
  ~MemoryBudget();
  Charge charge(Place, const char* kind, const MemoryAccount&, std::uint64_t bytes);
  void make_room(Place, const char* kind, const MemoryAccount&, std::uint64_t bytes);
  // `account`: whose bytes it would give back.
  void add(Place, const MemoryAccount& account, std::weak_ptr<Reclaimable>);
  std::uint64_t held(Place) const;
  std::uint64_t held(Place, const std::string& client) const;
  std::vector<MemoryUse> uses() const;  // what is held now, by place and kind

 private:
  friend class Charge;
  struct Side;
  struct Lack;
  Lack lack(const Side&, Place, const char* kind, const MemoryAccount&, std::uint64_t bytes) const;
  void fit(std::unique_lock<std::mutex>&, Place, const char* kind, const MemoryAccount&, std::uint64_t bytes);
  bool reclaim(Place, const std::string* client);
  void give(Charge::Holder*, std::uint64_t bytes);

  struct Side {
    std::uint64_t budget = 0, client_budget = 0, held = 0;
    std::map<std::string, std::uint64_t> by_client;
    std::vector<std::pair<std::string, std::weak_ptr<Reclaimable>>> reclaimable;  // by client
    std::size_t prune_at = 64;  // entries, those that are gone among them
  };
  mutable std::mutex mutex_;
  PacedLog refusals_{"memory_refused"};
  std::vector<Side> sides_;  // by Place
  // By place, kind, client, scene; one that holds nothing is dropped.
  std::map<std::array<std::string, 4>, std::unique_ptr<Charge::Holder>> holders_;
};

}  // namespace teletact::service
