// Pieces of a contact law, as a service sends them.
#include "client/link/law_book.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "common/contact_law.h"
#include "tests/fuzzers/client/fuzzers.h"
#include "tests/fuzzers/support/delimited.h"

namespace teletact::fuzzers {
namespace {

using client::LawBook;
using client::NearLaw;

struct Asked {
  double x_m = 0, z_m = 0;
  bool guesses = true;
};

void check(const LawValue& value) {
  for (const double number :
       {value.energy_j, value.by_x_n, value.by_d_n, value.by_z_n, value.error_n, value.disagreement_n}) {
    require(std::isfinite(number), "a law's value that is not finite");
    require(value.covered || number == 0, "a value where nothing is covered");
  }
  require(value.energy_j >= 0 && value.error_n >= 0, "an energy or an error below zero");
  require(value.oldest <= value.newest, "an oldest version beyond the newest");
}

void check(const NearLaw& law, const Asked& asked) {
  require(law.count <= NearLaw::kMax, "more columns than the servo takes");
  const auto columns = law.used();
  std::set<double> lanes;
  for (std::size_t n = 0; n < columns.size(); ++n) {
    const LawColumn& column = columns[n];
    lanes.insert(column.z_m);
    require(usable(column), "a column that cannot be evaluated");
    require(asked.guesses || column.corrected, "a guess that was not asked for");
    if (n > 0)
      require(std::pair(columns[n - 1].z_m, columns[n - 1].x_m) < std::pair(column.z_m, column.x_m),
              "columns out of order");
  }
  require(lanes.size() <= NearLaw::kMaxLanes, "more lanes than the servo takes");
  for (std::size_t n = 0; n < std::min<std::size_t>(columns.size(), 8); ++n) {
    const LawColumn& column = columns[n];
    const LawColumn& next = columns[std::min(n + 1, columns.size() - 1)];
    for (const double indentation_m : {0.0, 1e-5, 0.003, 1.0}) {
      check(evaluate(columns, (column.x_m + next.x_m) / 2, indentation_m, (column.z_m + next.z_m) / 2));
      check(evaluate(columns, asked.x_m, indentation_m, asked.z_m));
    }
  }
}

}  // namespace

bool law_book(Bytes bytes) {
  LawBook book;
  book.open(0.01);
  Asked asked;
  bool any = false;
  require(book.fresh(asked.x_m, asked.z_m).has_value(), "a stream that was opened has nothing new to say");
  Delimited pieces(bytes);
  while (auto piece = pieces.next<v1::LawPiece>()) {
    const std::uint64_t before = book.pieces();
    if (piece->piece() == 0) piece->set_piece(before + 1);
    const bool next = piece->piece() == before + 1;
    const bool taken = book.take(*piece, asked.x_m, asked.z_m);
    require(book.pieces() == before + next, "pieces are counted wrong");
    require(!taken || next, "a piece out of order is taken");
    if (!taken) {
      require(!book.fresh(asked.x_m, asked.z_m, asked.guesses), "a piece that was refused changed the law");
      continue;
    }
    any = true;
    // The finger moves to where the newest piece is.
    asked = {piece->columns(0).x_m(), piece->z_m(), !asked.guesses};
    const auto law = book.fresh(asked.x_m, asked.z_m, asked.guesses);
    require(law.has_value(), "a new piece, and nothing new to say");
    check(*law, asked);
    require(!book.fresh(asked.x_m, asked.z_m, asked.guesses), "the same law is given twice");
  }
  return any;
}

}  // namespace teletact::fuzzers
