// The cells of a scene's map, in blocks of columns. A copy shares its blocks with the one that it was made
// from; a block is made or copied when it is first written to, and where nothing is published there is none.
// So an empty scene costs next to nothing, and a publication what it changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "service/base/memory.h"

namespace teletact::service {

enum class CellState : std::uint8_t { kUnknown = 0, kExtended = 1, kMeasured = 2 };

struct Cell {
  float modulus_pa = 0;
  CellState state = CellState::kUnknown;
  float log_deviation = std::numeric_limits<float>::quiet_NaN();
};

// Not thread-safe while it is written to; copies are independent of each other.
class CellBlocks {
 public:
  static constexpr std::size_t kColumns = 64;  // of a block, 32 mm

  CellBlocks(std::size_t nx, std::size_t ny, MemoryAccount account)
      : nx_(nx),
        ny_(ny),
        account_(std::move(account)),
        blocks_((nx + kColumns - 1) / kColumns),
        own_(blocks_.size()) {}
  CellBlocks(const CellBlocks& other)
      : nx_(other.nx_),
        ny_(other.ny_),
        account_(other.account_),
        blocks_(other.blocks_),
        own_(blocks_.size()) {}
  CellBlocks& operator=(const CellBlocks&) = delete;

  Cell at(std::size_t i, std::size_t j) const {
    const Block* const block = blocks_[i / kColumns].get();
    if (!block) return {};
    const std::size_t n = i % kColumns + kColumns * j;
    return {block->modulus_pa[n], block->states[n], block->log_deviation[n]};
  }
  // Columns [begin, end) may be written to afterwards. Throws MemoryRefused; nothing is changed then.
  void make_writable(std::size_t begin, std::size_t end) {
    const std::size_t first = begin / kColumns, last = (end + kColumns - 1) / kColumns;
    auto made = own_;
    for (std::size_t b = first; b < last; ++b)
      if (!made[b]) made[b] = std::make_shared<Block>(blocks_[b].get(), ny_, account_);
    own_.swap(made);
    for (std::size_t b = first; b < last; ++b) blocks_[b] = own_[b];
  }
  void set(std::size_t i, std::size_t j, const Cell& cell) {
    Block& block = *own_[i / kColumns];
    const std::size_t n = i % kColumns + kColumns * j;
    block.modulus_pa[n] = cell.modulus_pa, block.states[n] = cell.state;
    block.log_deviation[n] = cell.log_deviation;
  }
  std::size_t blocks() const { return blocks_.size(); }
  // Of a block: another number whenever it is written to anew in a later copy; 0: there is none.
  std::uint64_t stamp(std::size_t block) const { return blocks_[block] ? blocks_[block]->stamp : 0; }
  // Blocks of this one that `other` has too.
  std::size_t shared_with(const CellBlocks& other) const {
    std::size_t shared = 0;
    for (std::size_t b = 0; b < blocks_.size(); ++b) shared += blocks_[b] && blocks_[b] == other.blocks_[b];
    return shared;
  }

 private:
  struct Block {
    Block(const Block* from, std::size_t ny, const MemoryAccount& account)
        : charge(account.charge(Place::kHost, "maps", kColumns * ny * kCellBytes)),
          modulus_pa(from ? from->modulus_pa : std::vector<float>(kColumns * ny, Cell().modulus_pa)),
          states(from ? from->states : std::vector<CellState>(kColumns * ny, Cell().state)),
          log_deviation(from ? from->log_deviation
                             : std::vector<float>(kColumns * ny, Cell().log_deviation)) {}
    static constexpr std::size_t kCellBytes = 2 * sizeof(float) + sizeof(CellState);
    const std::uint64_t stamp = use_stamp();
    Charge charge;
    std::vector<float> modulus_pa;
    std::vector<CellState> states;
    std::vector<float> log_deviation;
  };
  std::size_t nx_, ny_;
  MemoryAccount account_;
  std::vector<std::shared_ptr<const Block>> blocks_;
  std::vector<std::shared_ptr<Block>> own_;  // those of them that were made here
};

}  // namespace teletact::service
