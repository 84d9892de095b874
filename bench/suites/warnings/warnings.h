#pragma once

namespace CLI {
class App;
}

namespace teletact::bench {

// Adds the subcommand and sets `met` when it has run.
void add_warnings_suite(CLI::App& app, bool& met);

}  // namespace teletact::bench
