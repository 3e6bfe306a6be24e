export class B {}
function start() {}
export { start as default };
