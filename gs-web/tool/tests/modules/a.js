import start, { B } from "./b.js";
start(new B());
