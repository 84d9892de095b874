// The budget of memory: what is held is counted, what does not fit is refused with the sizes, what nobody
// uses is given back in the order of last use, and a client is kept to its share without harm to others.
#include "service/base/memory.h"

#include "service/base/limits.h"

#include <gtest/gtest.h>

#include <optional>
#include <thread>

namespace teletact::service {
namespace {

std::shared_ptr<MemoryBudget> budget_of(std::uint64_t host, std::uint64_t device, double share) {
  Limits limits;
  limits.host_memory_bytes = host, limits.device_memory_bytes = device, limits.client_memory_share = share;
  return std::make_shared<MemoryBudget>(limits);
}

std::string why_refused(const MemoryAccount& account, Place place, std::uint64_t bytes) {
  try {
    account.charge(place, "thing", bytes);
    return "";
  } catch (const MemoryRefused& refused) {
    return refused.what();
  }
}

// A block that can be made again.
class Block final : public Reclaimable {
 public:
  static std::shared_ptr<Block> make(const MemoryAccount& account, std::uint64_t bytes) {
    auto block = std::make_shared<Block>();
    block->charge_ = account.charge(Place::kHost, "block", bytes);
    account.add(Place::kHost, block);
    return block;
  }
  void use() { used_ = use_stamp(); }
  bool held() const {
    const std::lock_guard lock(mutex_);
    return charge_.bytes() > 0;
  }
  bool in_use = false;
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override {
    const std::lock_guard lock(mutex_);
    if (in_use || charge_.bytes() == 0) return false;
    charge_ = {};
    return true;
  }

 private:
  mutable std::mutex mutex_;
  Charge charge_;
  std::uint64_t used_ = use_stamp();
};

TEST(Memory, WhatIsHeldIsCountedUntilItIsGone) {
  const auto budget = budget_of(1000, 100, 1);
  const MemoryAccount anna{budget, "anna", "liver"}, berta{budget, "berta", ""};
  {
    Charge one = anna.charge(Place::kHost, "model", 300);
    Charge moved = std::move(one);
    const Charge two = berta.charge(Place::kHost, "model", 200),
                 three = anna.charge(Place::kDevice, "solver", 50);
    EXPECT_EQ(one.bytes(), 0U);
    EXPECT_EQ(budget->held(Place::kHost), 500U);
    EXPECT_EQ(budget->held(Place::kHost, "anna"), 300U);
    const auto uses = budget->uses();
    ASSERT_EQ(uses.size(), 2U);
    for (const MemoryUse& use : uses)
      EXPECT_EQ(use.bytes, use.place == Place::kHost ? 500U : 50U) << use.kind;
    moved.shrink(100);
    EXPECT_EQ(budget->held(Place::kHost), 300U);
    moved = anna.charge(Place::kHost, "columns", 10);  // what it held before is returned
    EXPECT_EQ(budget->held(Place::kHost, "anna"), 10U);
  }
  EXPECT_EQ(budget->held(Place::kHost), 0U);
  EXPECT_EQ(budget->held(Place::kDevice), 0U);
  EXPECT_TRUE(budget->uses().empty());
}

TEST(Memory, WhatDoesNotFitIsRefusedWithTheSizesAndLeavesNothing) {
  const auto budget = budget_of(1000, 100, 0.5);
  const MemoryAccount anna{budget, "anna", ""}, berta{budget, "berta", ""}, itself{budget, "", ""};
  const Charge held = anna.charge(Place::kHost, "model", 400);
  const std::string share = why_refused(anna, Place::kHost, 101);
  for (const char* word : {"101 bytes", "thing", "400 of the 500", "host", "delete scenes"})
    EXPECT_NE(share.find(word), std::string::npos) << share;
  EXPECT_EQ(why_refused(anna, Place::kHost, 100), "");
  EXPECT_EQ(why_refused(berta, Place::kHost, 500), "") << "another client's share is its own";
  EXPECT_EQ(why_refused(itself, Place::kHost, 600), "") << "the service itself has no share to keep to";
  const std::string all = why_refused(itself, Place::kHost, 601);
  EXPECT_NE(all.find("400 of 1000"), std::string::npos) << all;
  EXPECT_NE(why_refused(anna, Place::kHost, UINT64_MAX), "");
  EXPECT_NE(why_refused(itself, Place::kHost, UINT64_MAX), "");
  EXPECT_NE(why_refused(berta, Place::kDevice, 51).find("device"), std::string::npos);
  EXPECT_EQ(budget->held(Place::kHost), 400U);
  EXPECT_EQ(budget->held(Place::kHost, "berta"), 0U);
  EXPECT_EQ(why_refused({}, Place::kHost, UINT64_MAX), "") << "without a budget nothing is counted";
}

TEST(Memory, WhatWasUsedLeastRecentlyIsGivenBackFirst) {
  const auto budget = budget_of(100, 0, 1);
  const MemoryAccount anna{budget, "anna", ""};
  const auto a = Block::make(anna, 30), b = Block::make(anna, 30), c = Block::make(anna, 30);
  a->use();
  {
    const Charge more = anna.charge(Place::kHost, "model", 40);
    EXPECT_TRUE(a->held() && !b->held() && c->held());
  }
  b->in_use = c->in_use = true;
  EXPECT_NE(why_refused(anna, Place::kHost, 80), "") << "c is in use";
  EXPECT_TRUE(!a->held() && c->held()) << "what was not enough may be gone, what is used may not";
  c->in_use = false;
  EXPECT_EQ(why_refused(anna, Place::kHost, 100), "");
  EXPECT_FALSE(c->held());
}

TEST(Memory, AClientAtItsShareTakesNothingFromOthers) {
  const auto budget = budget_of(100, 0, 0.5);
  const MemoryAccount anna{budget, "anna", ""}, berta{budget, "berta", ""};
  const auto hers = Block::make(anna, 30), old = Block::make(berta, 30);
  hers->use();
  EXPECT_NE(why_refused(berta, Place::kHost, 51), "") << "more than one client may ever hold";
  EXPECT_TRUE(hers->held() && old->held());
  EXPECT_EQ(why_refused(berta, Place::kHost, 40), "") << "berta's own is given back";
  EXPECT_TRUE(hers->held() && !old->held());
  const Charge full = MemoryAccount{budget, "", ""}.charge(Place::kHost, "model", 60);
  EXPECT_EQ(why_refused(berta, Place::kHost, 20), "") << "the service is full: anybody's cache goes";
  EXPECT_FALSE(hers->held());
}

TEST(Memory, RoomIsMadeBeforehandForWhatComesInParts) {
  const auto budget = budget_of(100, 0, 1);
  const MemoryAccount anna{budget, "anna", ""};
  const auto block = Block::make(anna, 30);
  EXPECT_THROW(anna.make_room(Place::kHost, "image", 101), MemoryRefused);
  EXPECT_TRUE(block->held()) << "what can never fit costs nobody anything";
  anna.make_room(Place::kHost, "image", 80);
  EXPECT_FALSE(block->held());
  EXPECT_EQ(budget->held(Place::kHost), 0U);
}

TEST(Memory, ManyThreadsLeaveNothingBehind) {
  const auto budget = budget_of(1000, 0, 0.4);
  std::vector<std::thread> threads;
  std::atomic<int> refused{0}, beyond{0};
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      const MemoryAccount account{budget, "client-" + std::to_string(t % 3), ""};
      std::vector<std::shared_ptr<Block>> blocks;
      for (int k = 0; k < 500; ++k) {
        try {
          blocks.push_back(Block::make(account, static_cast<std::uint64_t>(1 + (k * 7 + t) % 150)));
        } catch (const MemoryRefused&) {
          ++refused;
        }
        if (k % 5 == 0) blocks.clear();
        if (budget->held(Place::kHost) > 1000 || budget->held(Place::kHost, account.client) > 400) ++beyond;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(beyond, 0);
  EXPECT_EQ(budget->held(Place::kHost), 0U);
  EXPECT_TRUE(budget->uses().empty());
}

TEST(Memory, EachDeviceHasABudgetOfItsOwn) {
  Limits limits;
  limits.host_memory_bytes = 1000, limits.device_memory_bytes = 100, limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits, 2);
  const MemoryAccount anna{budget, "anna", "s"};
  const Charge first = anna.charge(place_of_device(0), "arrays", 100);
  const Charge second = anna.charge(place_of_device(1), "arrays", 60);
  EXPECT_EQ(budget->held(Place::kDevice), 100U);
  EXPECT_EQ(budget->held(place_of_device(1)), 60U);
  EXPECT_THROW(anna.charge(place_of_device(0), "arrays", 1), MemoryRefused);
  EXPECT_THROW(anna.charge(place_of_device(1), "arrays", 41), MemoryRefused);
  std::vector<std::string> places;
  for (const MemoryUse& use : budget->uses()) places.push_back(name_of(use.place));
  EXPECT_EQ(places, (std::vector<std::string>{"device", "device 1"}));
}

}  // namespace
}  // namespace teletact::service
