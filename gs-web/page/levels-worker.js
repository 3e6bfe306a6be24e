// The worker of the page that reads levels of detail.

import init, { Levels, startThreads } from "./gs_web.js";
import { serveLevels } from "./levels.js";

serveLevels(async (module) => {
  await init({ module_or_path: module });
  startThreads(1);
  return Levels;
});
