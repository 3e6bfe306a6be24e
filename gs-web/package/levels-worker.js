// The worker of a viewer that reads levels of detail.

import init, { Levels } from "./gs_viewer.js";
import { serveLevels } from "./levels.js";

serveLevels(async (module) => {
  await init({ module_or_path: module });
  return Levels;
});
