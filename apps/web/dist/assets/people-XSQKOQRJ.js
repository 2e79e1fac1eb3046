import"./chunk-VSDYETHS.js";import{O as t,y as e}from"./chunk-ZJKHKGPO.js";function o(){return e(t,{title:"People",text:"This page is being built."})}export{o as People};
