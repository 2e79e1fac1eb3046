import{a,b,c}from"./chunk-HEFYSEYJ.js";import"./chunk-A4GG5OEZ.js";import"./chunk-GC6LIKR3.js";export{c as Live,b as LiveFigures,a as WALL};
